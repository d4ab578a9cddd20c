"""Write the section of RESULTS.md on mixtures from the records of `hof-model mixtures`, verdict included."""

from pathlib import Path

import numpy as np

from model.data.manifest import Split
from model.evaluation.locations import MIXTURES
from model.evaluation.mixtures import (
    AVERAGE,
    CLOUD_POINTS,
    COPY,
    FIGURES,
    PAIRS,
    SHOWN,
    Mixtures,
    even_words,
    measure,
    mixed_words,
)
from model.metrics import interval
from model.report.tables import spread, table
from service.drawing.words import rows_of_words
from service.encoding.encoder import Encoder


def write(encoder: Encoder, data: Path, split: Split, root: Path, seed: int = 0) -> str:
    """Measure a model's mixtures, write figures and picture below `root`, and return their part of RESULTS.md."""
    mixtures, picture = measure(encoder, data, split, seed)
    mixtures.write(root / MIXTURES / f"{encoder.name}.json")
    picture.quantize(64).save(root / MIXTURES / f"{encoder.name}.png", optimize=True)
    return _of_model(mixtures)


def section(root: Path) -> str:
    """Return the section, empty if nothing has been measured.

    Raises
    ------
    ValueError : a file in the folder holds something else.
    """
    records = [Mixtures.read(path) for path in sorted((root / MIXTURES).glob("*.json"))]
    if not records:
        return ""
    return f"""## Mixtures

A k-mapping composes two objects A and B into words such as *f*_A(*f*_B(x)); the alternative is to average their thetas.
The paper finds that words give coherent objects and averages do not. `hof-model mixtures --model FILE` measures this on
{PAIRS} random pairs of objects, half within a class and half across classes if there are enough; each object is encoded
from one view. Distances are cd_epcg, both directions summed, x100, {CLOUD_POINTS:,} against {CLOUD_POINTS:,} points: to
the nearest of all training objects, and to other samples of the objects A and B as the model draws them. A mixture is a
copy if it is at most {COPY} times as far from a parent as another sample of that parent is.

{chr(10).join(_of_model(each) for each in records)}"""


def _of_model(mixtures: Mixtures) -> str:
    count = int(mixtures.in_class.sum())
    words = ", ".join(word for row in rows_of_words(mixtures.k) for word in row)
    return f"""### {mixtures.model}, k = {mixtures.k}

{len(mixtures.pairs)} pairs of the {mixtures.split} split, {count} within a class, {len(mixtures.pairs) - count} across
classes; sha256 {mixtures.origin["digest"][:16]}, commit {mixtures.origin["commit"]}, seed {mixtures.origin["seed"]}.

{_distances(mixtures)}

Paired differences of the distance to the nearest training object, with their interval, bold where it excludes 0. Words:
the mean of {" and ".join(even_words(mixtures.k))}.

{_differences(mixtures)}

{verdict(mixtures)}

The first {SHOWN} pairs of each kind: {words} and the average.

![mixtures of {mixtures.model}]({MIXTURES}/{mixtures.model}.png)
"""


def _distances(mixtures: Mixtures) -> str:
    """Return the table of distances: every mixture, then its parents, over all pairs."""
    rows = []
    for name in [*mixed_words(mixtures.k), AVERAGE]:
        of = mixtures.figures[name]
        figures = [of["nearest"], of["to_a"], of["to_b"], np.minimum(of["to_a"], of["to_b"])]
        rows.append([name, *(spread(interval(each)) for each in figures), f"{100 * mixtures.copies(name).mean():.1f}%"])
    for name in "AB":
        of = mixtures.figures[name]
        rows.append([f"the object {name}", *(spread(interval(of[figure])) for figure in FIGURES), "-", "-"])
    return table(["mixture", "to the nearest training object", "to A", "to B", "to the nearer parent", "copies"], rows)


def _differences(mixtures: Mixtures) -> str:
    words, average, parents = (
        mixtures.words("nearest"),
        mixtures.figures[AVERAGE]["nearest"],
        mixtures.parents("nearest"),
    )
    in_class = mixtures.in_class
    rows = []
    for name, chosen in (("all", in_class | True), ("within a class", in_class), ("across classes", ~in_class)):
        if chosen.any():
            gaps = [interval(gap[chosen]) for gap in (average - words, words - parents, average - parents)]
            rows.append([name, str(chosen.sum()), *map(_mark, gaps)])
    return table(["pairs", "number", "average minus words", "words minus objects", "average minus objects"], rows)


def verdict(mixtures: Mixtures) -> str:
    """Return the sentences on whether averaging gives blobs, decided by the figures."""
    average = mixtures.figures[AVERAGE]
    to_real = interval(average["nearest"] - mixtures.words("nearest"))
    to_parents = interval((average["to_a"] + average["to_b"] - mixtures.words("to_a") - mixtures.words("to_b")) / 2)
    head = {
        "farther": "**Averaging gives blobs here, as the paper says**: averages lie farther from real shapes than",
        "nearer": "**Averaging gives no blobs here, unlike in the paper**: averages lie nearer to real shapes than",
        "as far": "**Whether averaging gives blobs remains open**: averages lie as far from real shapes as",
    }[_side(to_real)]
    than = "as" if _side(to_parents) == "as far" else "than"
    return (
        f"{head} words do ({spread(to_real, '+')}). From their two parents, on average, they lie {_side(to_parents)} "
        f"{than} words do ({spread(to_parents, '+')})."
    )


def _side(gap: tuple[float, float, float]) -> str:
    """Classify a paired difference of distances by its interval."""
    return "farther" if gap[1] > 0 else "nearer" if gap[2] < 0 else "as far"


def _mark(gap: tuple[float, float, float]) -> str:
    return f"**{spread(gap, '+')}**" if _side(gap) != "as far" else spread(gap, "+")

"""The section of RESULTS.md on mixtures: written from the files of `hof-model mixtures`, its words too."""

from pathlib import Path

import numpy as np

from model.data.manifest import Split
from model.evaluation.mixtures import (
    AVERAGE,
    COPY,
    FIGURES,
    PAIRS,
    POINTS,
    SHOWN,
    Mixtures,
    even_words,
    measure,
    mixed_words,
)
from model.evaluation.paths import MIXTURES
from model.metrics import interval
from model.report.tables import spread, table
from service.drawing.words import rows_of_words
from service.encoding.encoder import Encoder


def write(encoder: Encoder, data: Path, split: Split, root: Path, seed: int = 0) -> str:
    """Measure a model's mixtures; write the figures and the picture below `root`. Returns what RESULTS.md will say."""
    found, picture = measure(encoder, data, split, seed)
    found.write(root / MIXTURES / f"{encoder.name}.json")
    picture.quantize(64).save(root / MIXTURES / f"{encoder.name}.png", optimize=True)
    return _of_model(found)


def section(root: Path) -> str:
    """The whole section; empty where nothing has been measured. Raises ValueError for a file of something else."""
    found = [Mixtures.read(path) for path in sorted((root / MIXTURES).glob("*.json"))]
    if not found:
        return ""
    return f"""## Mixtures

Of two objects A and B a k-mapping makes words, *f*_A(*f*_B(x)) say; or the numbers of their thetas are averaged. The
paper finds that words give coherent objects and that averages do not. `hof-model mixtures --model FILE` measures it on
{PAIRS} random pairs of objects, half of one class and half of two, as far as there are so many; each object is encoded
from one view. Distances are cd_epcg, both directions summed, x100, {POINTS:,} against {POINTS:,} points: to the nearest
of all training objects, and to other samples of the objects A and B as the model draws them. A copy is at most {COPY}
times as far from a parent as another sample of that parent is.

{chr(10).join(_of_model(each) for each in found)}"""


def _of_model(found: Mixtures) -> str:
    count = int(found.in_class.sum())
    words = ", ".join(word for row in rows_of_words(found.k) for word in row)
    return f"""### {found.model}, k = {found.k}

{len(found.pairs)} pairs of the {found.split} split, {count} of one class, {len(found.pairs) - count} of two; sha256
{found.made["digest"][:16]}, commit {found.made["commit"]}, seed {found.made["seed"]}.

{_distances(found)}

Differences pair by pair of the distance to the nearest training object, with the paired interval; bold where it
excludes 0. Words: the mean of {" and ".join(even_words(found.k))}.

{_differences(found)}

{verdict(found)}

The first {SHOWN} pairs of each kind: {words} and the average.

![mixtures of {found.model}]({MIXTURES}/{found.model}.png)
"""


def _distances(found: Mixtures) -> str:
    """Every mixture, then its parents, over all pairs."""
    rows = []
    for name in [*mixed_words(found.k), AVERAGE]:
        of = found.figures[name]
        figures = [of["nearest"], of["to_a"], of["to_b"], np.minimum(of["to_a"], of["to_b"])]
        rows.append([name, *(spread(interval(each)) for each in figures), f"{100 * found.copies(name).mean():.1f}%"])
    for name in "AB":
        of = found.figures[name]
        rows.append([f"the object {name}", *(spread(interval(of[figure])) for figure in FIGURES), "-", "-"])
    return table(["mixture", "to the nearest training object", "to A", "to B", "to the nearer parent", "copies"], rows)


def _differences(found: Mixtures) -> str:
    words, average, parents = found.words("nearest"), found.figures[AVERAGE]["nearest"], found.parents("nearest")
    in_class = found.in_class
    rows = []
    for name, chosen in (("all", in_class | True), ("of one class", in_class), ("of two classes", ~in_class)):
        if chosen.any():
            gaps = [interval(gap[chosen]) for gap in (average - words, words - parents, average - parents)]
            rows.append([name, str(chosen.sum()), *map(_marked, gaps)])
    return table(["pairs", "number", "average minus words", "words minus objects", "average minus objects"], rows)


def verdict(found: Mixtures) -> str:
    """Whether averaging gives blobs, in sentences that the figures decide."""
    average = found.figures[AVERAGE]
    to_real = interval(average["nearest"] - found.words("nearest"))
    to_parents = interval((average["to_a"] + average["to_b"] - found.words("to_a") - found.words("to_b")) / 2)
    head = {
        "farther": "**Averaging gives blobs here, as the paper says**: averages lie farther from real shapes than",
        "nearer": "**Averaging gives no blobs here, unlike in the paper**: averages lie nearer to real shapes than",
        "as far": "**Whether averaging gives blobs stays open**: averages lie as far from real shapes as",
    }[_side(to_real)]
    than = "as" if _side(to_parents) == "as far" else "than"
    return (
        f"{head} words do ({spread(to_real, '+')}). From their two parents, on average, they lie {_side(to_parents)} "
        f"{than} words do ({spread(to_parents, '+')})."
    )


def _side(gap: tuple[float, float, float]) -> str:
    """What a paired difference of distances says."""
    return "farther" if gap[1] > 0 else "nearer" if gap[2] < 0 else "as far"


def _marked(gap: tuple[float, float, float]) -> str:
    return f"**{spread(gap, '+')}**" if _side(gap) != "as far" else spread(gap, "+")

"""Several views aggregated: sets of views, words, and the section of PAPER.md."""

from pathlib import Path

import numpy as np
import pytest

from model import cli
from model.evaluation.paper.record import PaperRecord, Trial
from model.evaluation.paper.views import (
    CODES,
    COMPOSED,
    COUNTS,
    MEDOID,
    ONE,
    THETAS,
    UNION,
    Head,
    aggregates,
    figures_of,
    trial_name,
    words,
)
from model.export import export
from model.metrics import NAMES, Floats
from model.networks.encoder import ImageEncoder
from model.networks.inner import InnerEncoder
from model.report.paper import views
from service.mapping.sampler import Sampler
from service.mapping.spec import MappingSpec, initial_theta, word_of
from tests.support.small import data as small_data
from tests.support.small.network import CONFIG

SPEC = MappingSpec("tiny", 3, (16,), 3, k=2)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export an encoder that was not trained."""
    path = tmp_path_factory.mktemp("views") / "small.onnx"
    export(ImageEncoder(CONFIG.spec, CONFIG.encoder, CONFIG.framing.size).eval(), CONFIG, {"name": "small"}, path)
    return path


def _thetas(*seeds: int) -> Floats:
    return np.stack([initial_theta(SPEC, seed) for seed in seeds])


def _identity(code: Floats) -> Floats:
    return code


def test_words_are_neighbors_around_the_object() -> None:
    thetas = np.arange(4, dtype=np.float32)[:, None]
    assert words(thetas, 2, 0)[:, 0].tolist() == [0, 1]
    assert words(thetas, 3, 3)[:, 0].tolist() == [3, 0, 1]


def test_aggregates_of_equal_views_are_the_view() -> None:
    thetas = _thetas(1, 1, 1, 1)
    own = Sampler(SPEC, word_of(SPEC, thetas[0])).points(2_500)
    for name, aggregate in aggregates(SPEC, _identity).items():
        points = aggregate(thetas, thetas)
        assert points.shape == (10_000, 3), name
        np.testing.assert_allclose(points[:2_500], own, atol=1e-6)


def test_aggregates_of_different_views_are_as_named() -> None:
    ways, thetas = aggregates(SPEC, _identity), _thetas(1, 2)
    word = Sampler(SPEC, (thetas[0], thetas[1])).points(5_000)
    np.testing.assert_allclose(ways[COMPOSED](thetas, thetas)[:5_000], word, atol=1e-6)
    mean = Sampler(SPEC, word_of(SPEC, thetas.mean(axis=0))).points(10_000)
    np.testing.assert_allclose(ways[THETAS](thetas, thetas), mean, atol=1e-6)
    np.testing.assert_allclose(ways[CODES](thetas, thetas), mean, atol=1e-6)
    near = _thetas(1, 1, 9)
    own = Sampler(SPEC, word_of(SPEC, near[0])).points(10_000)
    np.testing.assert_allclose(ways[MEDOID](near, near), own, atol=1e-6)


def test_figures_of_each_count_use_all_views() -> None:
    thetas = _thetas(*range(8))
    true = Sampler(SPEC, word_of(SPEC, thetas[5])).points(10_000)
    figures = figures_of(aggregates(SPEC, _identity), thetas, thetas, true)
    assert set(figures) == {ONE} | {trial_name(method, n) for method in views.METHODS for n in COUNTS[1:]}
    assert figures[ONE]["f@1%"] >= 1 / 8  # the fifth view is the object itself
    assert figures[trial_name(THETAS, 4)] == pytest.approx(figures[trial_name(CODES, 4)])


def test_head_of_an_exported_encoder_gives_its_theta(exported: Path) -> None:
    inner, head = InnerEncoder(exported, threads=1), Head(exported)
    theta, tensors = inner.look(np.random.default_rng(0).random((1, 3, inner.size, inner.size), np.float32))
    np.testing.assert_allclose(head(tensors["code"][0]), theta[0], atol=1e-5)


def _record(best: str) -> PaperRecord:
    names = [ONE, *(trial_name(method, count) for method in views.METHODS for count in COUNTS[1:])]
    rows = {name: [0.2 + 0.001 * index + 0.1 * name.startswith(best) for index in range(3)] for name in names}
    trials = [Trial(name, {metric: list(rows[name]) for metric in NAMES}) for name in names]
    setting = {"split": "test", "objects": 3, "views": [1, 4], "points": 10_000, "gap": 1e-6}
    origin = {"model": "m", "k": 2, "machine": "x", "date": "y", "commit": "z", "seed": 0}
    return PaperRecord("views", setting, origin, ["1", "2", "3"], ["chair"] * 3, trials)


@pytest.mark.parametrize("best", [THETAS, MEDOID])
def test_section_names_the_way_that_the_service_uses(best: str) -> None:
    text = views.section(_record(best))
    assert views.winner(_record(best)) == best
    assert f"*{best}* is best over all counts" in text
    assert f"- {best}: +0.100 (+0.100 to +0.100) for 2" in text
    assert f"- {UNION}: +0.000 (+0.000 to +0.000) for 2" in text


@pytest.mark.slow
def test_command_paper_views_writes_record_and_page(exported: Path, tmp_path: Path) -> None:
    small = small_data.write(tmp_path / "data", train=0, test=2)
    command = ["paper", "views", "--model", str(exported), "--data", str(small), "-o", str(tmp_path)]
    assert cli.main(command) == 0
    assert "## Several views of one object" in (tmp_path / "PAPER.md").read_text()

"""A latent vector is a bias of the first layer."""

from pathlib import Path

import numpy as np
import pytest

from model import cli
from model.evaluation.paper.latent import FIGURE, LATENT, OBJECTS, as_bias, measure_latent, with_latent
from model.evaluation.paper.record import PaperRecord
from model.report.paper import latent
from model.report.paper.page import record_path
from service.mapping.canonical import canonical_points
from service.mapping.spec import HOF_1, HOF_3, MappingSpec, apply, initial_theta, layers


@pytest.mark.parametrize("spec", [HOF_1, HOF_3], ids=["HOF-1", "HOF-3"])
def test_latent_vector_equals_biases_of_the_first_layer(spec: MappingSpec) -> None:
    rng = np.random.default_rng(0)
    theta, z = initial_theta(spec, 1), rng.normal(size=LATENT).astype(np.float32)
    w_z = rng.normal(size=(spec.hidden[0], LATENT)).astype(np.float32) / 16
    x = canonical_points(spec.domain, 500)
    own = as_bias(spec, theta, w_z, z)
    points = with_latent(spec, theta, w_z, z, x)
    np.testing.assert_allclose(apply(spec, own, x), points, atol=1e-5 * float(np.abs(points).max()))
    changed = np.flatnonzero(own != theta)
    first = spec.hidden[0]
    assert set(changed) <= set(range(3 * first, 4 * first))  # the biases of the first layer
    assert len(changed) > 0.9 * first
    assert np.abs(points - apply(spec, theta, x)).max() > 0.1  # the latent vector matters
    np.testing.assert_array_equal(layers(spec, own)[0][0], layers(spec, theta)[0][0])


@pytest.mark.slow
def test_section_tells_whether_the_difference_is_rounding() -> None:
    record = measure_latent()
    assert len(record.ids) == OBJECTS
    assert "holds, to rounding" in latent.section(record)
    wrong = record.trials[0].figures[FIGURE]
    wrong[0] = 0.1
    assert "does not hold" in latent.section(record)


@pytest.mark.slow
def test_command_paper_latent_writes_record_and_page(tmp_path: Path) -> None:
    assert cli.main(["paper", "latent", "-o", str(tmp_path)]) == 0
    record = PaperRecord.read(record_path(tmp_path, "latent"))
    assert len(record.trials) == 4
    assert "## A latent vector as a bias" in (tmp_path / "PAPER.md").read_text()

"""Ways to make a surface, measured on the identity function."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from model import cli
from model.evaluation.locations import SURFACES
from model.evaluation.surfaces import CLOUD, WAYS, Trials
from model.report.surfaces import section
from service.mapping.sampler import Sampler
from service.mapping.spec import MappingSpec
from tests.support.small import data as small_data
from tests.support.small.trials import trials

pytestmark = pytest.mark.slow

SPEC = MappingSpec("identity", 3, (6,), 3, domain="sphere")


@pytest.fixture(scope="module")
def unit_sphere() -> Sampler:
    eye = np.eye(3, dtype=np.float32)
    parts = [np.concatenate([eye, -eye]), np.zeros(6), np.concatenate([eye, -eye], axis=1), np.zeros(3)]
    return Sampler(SPEC, [np.concatenate([part.ravel() for part in parts], dtype=np.float32)])


@pytest.mark.parametrize("way", WAYS)
def test_ways_identity_on_a_sphere_return_the_sphere(unit_sphere: Sampler, way: str) -> None:
    mesh = trimesh.Trimesh(*WAYS[way](unit_sphere), process=False)
    drawn, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1, atol=0.05)
    assert np.abs(drawn.mean(axis=0)).max() < 0.05


def test_trials_written_reads_back_equal(tmp_path: Path) -> None:
    trials(0.3, 2).write(tmp_path / "surfaces.json")
    assert Trials.read(tmp_path / "surfaces.json") == trials(0.3, 2)
    assert Trials.read(tmp_path / "surfaces.json") != replace(trials(0.3, 2), trials=[])


def test_command_surfaces_measures_every_way(
    model_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = small_data.write(tmp_path / "data", train=1, test=1)
    command = ["surfaces", "--model", str(model_path), "--data", str(data), "-o", str(tmp_path)]
    assert cli.main(command) == 0
    record = Trials.read(tmp_path / SURFACES)
    assert [trial.way for trial in record.trials] == [CLOUD, *WAYS]
    assert section(record) in capsys.readouterr().out

"""`hof-model fit` and `hof fit`: a mesh becomes a weights file that the service and the offline commands read."""

from pathlib import Path

import httpx
import numpy as np
import pytest
import trimesh

from model import cli as model_cli
from model.cli.fit import STEPS, K
from model.evaluation.fitting import MODEL, SPEC, fit_mesh
from model.evaluation.references import ceiling
from model.metrics import compare
from service.cli import fit as service_fit
from service.cli.main import main
from service.formats.weights import load
from service.mapping.sampler import Sampler
from service.mapping.spec import word_of

STEPS_OF_A_TEST = "60"


@pytest.fixture
def slab(tmp_path: Path) -> Path:
    """Write a slab: z is up, and its front is at -y."""
    path = tmp_path / "slab.ply"
    trimesh.creation.box((4, 2, 1)).export(path)
    return path


def test_defaults_of_the_command_are_those_of_the_fit() -> None:
    assert (ceiling.STEPS, SPEC.k) == (STEPS, K)


@pytest.mark.slow
def test_fit_of_more_steps_is_nearer_to_the_mesh(slab: Path) -> None:
    near, far = (fit_mesh(slab, steps=steps).figures["cd_sq"] for steps in (150, 3))
    assert near < far / 2


@pytest.mark.slow
def test_command_fit_writes_an_object_that_the_service_takes(
    slab: Path, tmp_path: Path, client: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "slab.safetensors"
    command = ["fit", str(slab), "-o", str(output), "--steps", STEPS_OF_A_TEST, "--up", "z"]
    assert model_cli.main(command) == 0
    assert f"{output}: 7,171 numbers; against the mesh cd_forward" in capsys.readouterr().out
    weights = load(output.read_bytes())
    assert (weights.spec, weights.model, weights.dtype) == (SPEC, MODEL, "float32")
    points = Sampler(SPEC, word_of(SPEC, weights.theta)).points(5_000)
    turned = trimesh.creation.box((1, 0.25, 0.5)).sample(5_000, seed=0).astype(np.float32)
    lying = trimesh.creation.box((1, 0.5, 0.25)).sample(5_000, seed=0).astype(np.float32)
    assert compare(points, turned)["cd_sq"] < compare(points, lying)["cd_sq"]
    imported = client.post("/objects", content=output.read_bytes())
    assert imported.status_code == 201
    assert main(["sample", str(output), "-o", str(tmp_path / "slab.npy")]) == 0
    again = tmp_path / "again.safetensors"
    assert main(["fit", str(slab), "-o", str(again), "--steps", STEPS_OF_A_TEST, "--up", "z"]) == 0
    repeated = load(again.read_bytes())  # sums in any order: not the same bits
    assert (repeated.spec, repeated.model) == (SPEC, MODEL)
    assert repeated.theta == pytest.approx(weights.theta, abs=0.01)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["slab.ply", "-o", "slab.ply"], "slab.ply: a function is written as .safetensors"),
        (["none.ply", "-o", "x.safetensors"], "none.ply is not there"),
        (["broken.ply", "-o", "x.safetensors"], "broken.ply: "),
        (["slab.ply", "-o", "x.safetensors", "--up", "y", "--front=-y"], "lie on one line"),
    ],
)
def test_command_fit_of_faulty_input_fails_with_one_line(
    slab: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(slab.parent)
    (slab.parent / "broken.ply").write_bytes(slab.read_bytes()[:-9])
    assert model_cli.main(["fit", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (slab.parent / "x.safetensors").exists()


def test_fit_without_its_extra_names_it(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(service_fit, "NEEDS", ("torch_that_is_not_there",))
    assert main(["fit", "mesh.glb", "-o", "x.safetensors"]) == 2
    assert "pip install '.[train]'" in capsys.readouterr().err

"""Theta against compressed meshes of as many bytes."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh

from model import cli
from model.data.build import build
from model.data.sources.meshes import folder_records
from model.evaluation.paper import compression
from model.evaluation.paper.compression import (
    BYTES,
    DRACO,
    DTYPES,
    FIGURES,
    FLOOR,
    GLTF,
    MOST_FACES,
    THETA,
    Triangles,
    decimated,
    draco_file,
    fitting,
    gltf_file,
    theta_files,
    trial_name,
)
from model.evaluation.paper.record import PaperRecord, Trial
from model.report.paper import compression as report
from model.report.paper.page import record_path
from service.formats.weights import Weights, load
from service.mapping.box import measure
from service.mapping.spec import MappingSpec, initial_theta
from tests.support.small.shapes import write_folder

SPEC = MappingSpec("small", 3, (32,), 3, k=2)


@pytest.fixture(scope="module")
def sphere() -> Triangles:
    shape = trimesh.creation.icosphere(5, 0.5)  # 20,480 triangles
    return Triangles(np.asarray(shape.vertices), np.asarray(shape.faces))


def test_theta_files_of_fewer_bytes_read_back() -> None:
    theta = initial_theta(SPEC)
    files = theta_files(Weights(SPEC, theta, "x", frame=measure(SPEC, theta)))
    assert len(files["float32"]) > len(files["float16"]) > len(files["int8"])
    for file in files.values():
        np.testing.assert_allclose(load(file).theta, theta, atol=0.01)


def test_decimated_meshes_become_coarser_and_keep_their_shape(sphere: Triangles) -> None:
    counts = []
    for coarse in decimated(sphere):
        counts.append(len(coarse.faces))
        if len(coarse.faces) > 100:
            np.testing.assert_allclose(np.linalg.norm(coarse.vertices, axis=1), 0.5, atol=0.05)
    assert counts[0] <= MOST_FACES
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] < 20


@pytest.mark.parametrize("bits", compression.BITS)
def test_draco_file_holds_the_mesh(sphere: Triangles, bits: int) -> None:
    data, held = draco_file(sphere, bits)
    assert len(data) < 12 * len(sphere.vertices)
    np.testing.assert_allclose(np.linalg.norm(held.vertices, axis=1), 0.5, atol=2**-bits)
    assert len(held.faces) == len(sphere.faces)


def test_gltf_file_holds_the_mesh(sphere: Triangles) -> None:
    data, held = gltf_file(sphere)
    np.testing.assert_allclose(held.vertices, sphere.vertices, atol=1e-4)
    read = trimesh.load(io.BytesIO(data), file_type="glb").to_geometry()
    assert len(read.faces) == len(sphere.faces)


def test_fitting_meshes_are_no_larger_than_the_limits(sphere: Triangles) -> None:
    meshes = fitting(sphere, {"float32": 20_000, "int8": 2_000})
    assert {len(meshes[trial_name(DRACO, dtype)]) for dtype in ("float32", "int8")} == {len(compression.BITS)}
    for name, variants in meshes.items():
        limit = 20_000 if name.endswith("float32") else 2_000
        for size, held in variants:
            assert size <= limit
            assert size > limit / 2 or len(held.faces) == len(sphere.faces)
            assert len(held.faces) > 20
    draco, gltf = (meshes[trial_name(method, "int8")][0][1] for method in (DRACO, GLTF))
    assert len(draco.faces) > 2 * len(gltf.faces)


def _trial(name: str, value: float | None, size: float | None) -> Trial:
    figures: dict[str, list[float | None]] = {figure: [value] * 3 for figure in FIGURES}
    return Trial(name, figures | {BYTES: [size] * 3})


def _record(theta: float, draco: float | None) -> PaperRecord:
    values = {THETA: theta, DRACO: draco, GLTF: 0.1}
    trials = [_trial(trial_name(method, dtype), value, 9.0) for method, value in values.items() for dtype in DTYPES]
    trials.append(_trial(FLOOR, 0.99, None))
    setting = {"split": "test", "objects": 3, "steps": 10, "points": 10_000, "bits": [8, 11]}
    origin = {"model": "HOF-1", "machine": "x", "date": "y", "commit": "z", "seed": 0}
    return PaperRecord("fit", setting, origin, ["1", "2", "3"], ["chair"] * 3, trials)


def test_section_compares_theta_with_meshes_of_as_many_bytes() -> None:
    text = report.section(_record(0.4, 0.7))
    assert "- Draco: -0.300 (-0.300 to -0.300) as float32; -0.300" in text
    assert "- glTF, quantized: +0.300" in text
    assert "float16 +0.000 (+0.000 to +0.000)" in text
    assert "no object is small enough as int8" in report.section(_record(0.4, None))


@pytest.mark.slow
def test_command_paper_fit_writes_record_and_page(tmp_path: Path) -> None:
    meshes = write_folder(tmp_path / "meshes")
    build(folder_records(meshes, "CC0"), tmp_path / "data", seed=0, processes=1)
    command = ["paper", "fit", "--data", str(tmp_path / "data"), "--meshes", str(meshes), "-o", str(tmp_path)]
    assert cli.main([*command, "--objects", "1", "--steps", "5"]) == 0
    record = PaperRecord.read(record_path(tmp_path, "fit"))
    assert record.setting["objects"] == 1
    assert record.trial(trial_name(THETA, "int8")).figures[BYTES][0]
    assert "## Mesh to function, and compressed meshes" in (tmp_path / "PAPER.md").read_text()

"""Files that the package writes, read by others: the Khronos validator, trimesh and the service."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.formats.weights import Weights, dump
from service.mapping.box import measure
from service.mapping.color import ColorSampler
from service.mapping.sampler import Sampler
from service.mapping.spec import Array
from service.mapping.surface import surface_of
from service.settings import SHIPPED_MODEL
from tests.client.js.conftest import Run
from tests.support.browsing import photo
from tests.support.gltf import check_valid

pytestmark = pytest.mark.system

TOLERANCE = 1e-4  # longest sides of the object
N = 2000
WRITE = """
import { readFile, writeFile } from "node:fs/promises";
import { pointsGlb, pointsPly, readFunctions, sample, sampleColors } from "hof-client";
import { surfaceGlb, surfaceOf, writeFunctions } from "hof-client";
const [folder, n] = [process.argv[1], Number(process.argv[2])];
const { buffer, byteOffset, length } = await readFile(`${folder}/service.safetensors`);
const functions = readFunctions(buffer.slice(byteOffset, byteOffset + length));
const word = process.argv[3] ? ["a", "b"] : [];
await writeFile(`${folder}/function.safetensors`, writeFunctions(functions, "hof1-k2", word));
await writeFile(`${folder}/surface.glb`, surfaceGlb(surfaceOf(functions)));
const { colorSpec, colorRows, ...plain } = functions;
await writeFile(`${folder}/plain.glb`, surfaceGlb(surfaceOf({ ...plain, colorRows: [] }, 20)));
const [points, colors] = [sample(functions, n), sampleColors(functions, n)];
await writeFile(`${folder}/points.glb`, pointsGlb(points, colors));
await writeFile(`${folder}/points.ply`, pointsPly(points, colors));
"""


@pytest.fixture(scope="module")
def chair() -> Weights:
    """Encode the demo's chair."""
    encoder = Encoder.open(SHIPPED_MODEL, threads=1)
    (encoded,) = encoder.encode(preprocess(photo("chair").read_bytes(), encoder.framing).tensor)
    frame = measure(encoder.spec, encoded.theta)
    return Weights(encoder.spec, encoded.theta, "hof1-k2", color=encoded.color, frame=frame)


@pytest.fixture(scope="module")
def written(npm: Run, built: Path, chair: Weights, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Let Node write every file of the chair; return their folder."""
    folder = tmp_path_factory.mktemp("written")
    (folder / "service.safetensors").write_bytes(dump(chair, "safetensors"))
    npm("node", "--input-type=module", "--eval", WRITE, str(folder), str(N))
    return folder


def _normals(glb: bytes) -> Array:
    """Return the normals in a GLB file, which trimesh computes anew."""
    (size,) = struct.unpack_from("<I", glb, 12)
    document = json.loads(glb[20 : 20 + size])
    view = document["bufferViews"][document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"]]
    start = 28 + size + view["byteOffset"]
    return np.frombuffer(glb[start : start + view["byteLength"]], "<f4").reshape(-1, 3)


def test_weights_file_has_the_bytes_of_the_service(written: Path) -> None:
    assert (written / "function.safetensors").read_bytes() == (written / "service.safetensors").read_bytes()


def test_weights_file_of_a_word_has_the_bytes_of_the_service(
    npm: Run, built: Path, chair: Weights, tmp_path: Path
) -> None:
    rows = np.stack([chair.theta, -chair.theta])
    word = Weights(chair.spec, rows, "hof1-k2", ("a", "b"), frame=measure(chair.spec, rows))
    (tmp_path / "service.safetensors").write_bytes(dump(word, "safetensors"))
    npm("node", "--input-type=module", "--eval", WRITE, str(tmp_path), str(N), "word")
    assert (tmp_path / "function.safetensors").read_bytes() == (tmp_path / "service.safetensors").read_bytes()


@pytest.mark.parametrize("name", ["surface", "plain", "points"])
def test_glb_is_valid(written: Path, tmp_path: Path, name: str) -> None:
    check_valid((written / f"{name}.glb").read_bytes(), tmp_path)


def test_surface_is_that_of_the_service(written: Path, chair: Weights) -> None:
    assert chair.color
    sampler = Sampler(chair.spec, [chair.theta] * chair.spec.k, chair.frame)
    expected = surface_of(sampler, color=ColorSampler(chair.color))
    mesh = trimesh.load(written / "surface.glb", process=False).to_geometry()
    assert len(mesh.faces) == pytest.approx(len(expected.triangles), rel=1e-3)  # those near the limit may differ
    area = trimesh.Trimesh(expected.vertices, expected.triangles, process=False).area
    assert mesh.area == pytest.approx(area, rel=1e-3)
    tree = trimesh.PointCloud(expected.vertices).kdtree
    distance, nearest = tree.query(mesh.vertices)
    assert np.quantile(distance, 0.999) < TOLERANCE
    normals = _normals((written / "surface.glb").read_bytes())
    assert np.quantile(abs(normals - expected.normals[nearest]).max(axis=1), 0.99) < 0.01


def test_points_are_those_of_the_service(written: Path, chair: Weights) -> None:
    assert chair.color
    expected = Sampler(chair.spec, [chair.theta] * chair.spec.k, chair.frame).points(N)
    cloud = trimesh.load(written / "points.ply")
    assert np.abs(cloud.vertices - expected).max() < TOLERANCE
    assert np.abs(cloud.colors[:, :3].astype(int) - ColorSampler(chair.color).colors(N)).max() <= 1

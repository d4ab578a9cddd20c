"""Points as arrays and files: exact, allocated once, and refused if the answer broke off."""

import asyncio
import itertools
import tracemalloc
from contextlib import aclosing
from pathlib import Path

import httpx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hof_client import AsyncClient, Client, InvalidParameter, StoredObject, Truncated, UnexpectedAnswer, Viewpoint
from hof_client.bodies import ColoredArrays, PointArray
from service.formats.points import ply
from tests.support.photos import disc, image_file
from tests.support.server import Open, Server
from tests.support.slow import runtime_of, until

N = 20_000


def _file(server: Server, object_id: str, **query: object) -> bytes:
    parameters = {name: str(value) for name, value in query.items()}
    answer = httpx.get(f"http://127.0.0.1:{server.port}/objects/{object_id}/points", params=parameters, timeout=60)
    return answer.raise_for_status().content


def test_points_equal_the_bytes_that_the_service_sends(
    hof: Client, colored_server: Server, disc_object: StoredObject
) -> None:
    points = hof.points(disc_object.id, N, seed=3, scale=2.5, sampling="sobol", frame="raw")
    query = {"n": N, "seed": 3, "scale": 2.5, "sampling": "sobol", "frame": "raw", "format": "f32"}
    assert points.tobytes() == _file(colored_server, disc_object.id, **query)
    assert (points.shape, points.dtype.name, points.flags.writeable) == ((N, 3), "float32", True)


def test_points_in_the_camera_frame_take_the_viewpoint(
    hof: Client, colored_server: Server, disc_object: StoredObject
) -> None:
    viewpoint = Viewpoint(azimuth=30, elevation=20, fx=500, cy=40)
    points = hof.points(disc_object.id, N, frame="camera", viewpoint=viewpoint)
    query = {"n": N, "frame": "camera", "azimuth": 30, "elevation": 20, "fx": 500, "cy": 40, "format": "f32"}
    assert points.tobytes() == _file(colored_server, disc_object.id, **query)
    with pytest.raises(InvalidParameter, match="give azimuth, elevation, distance"):
        hof.points(disc_object.id, N, frame="camera")


def test_points_of_the_client_are_prefix_stable(hof: Client, disc_object: StoredObject) -> None:
    points = hof.points(disc_object.id, N)
    assert np.array_equal(hof.points(disc_object.id, 1000), points[:1000])
    assert np.array_equal(hof.points(disc_object.id, 500, offset=N - 500), points[-500:])
    assert np.abs(points).max() <= 0.5 + 1e-6


def test_points_of_half_precision_are_those_of_full_precision(hof: Client, disc_object: StoredObject) -> None:
    half = hof.points(disc_object.id, 1000, precision="float16")
    assert half.dtype == np.float16
    assert np.allclose(half, hof.points(disc_object.id, 1000), atol=1e-3)


def test_chunks_of_points_are_the_points(hof: Client, disc_object: StoredObject) -> None:
    chunks = list(hof.iter_points(disc_object.id, 200_000))
    assert len(chunks) > 1
    assert all(chunk.ndim == 2 and len(chunk) for chunk in chunks)
    assert np.array_equal(np.concatenate(chunks), hof.points(disc_object.id, 200_000))


def test_iteration_that_is_left_frees_its_connection(colored_server: Server) -> None:
    url, n = f"http://127.0.0.1:{colored_server.port}", 10_000_000
    with Client(url) as client:
        object_id = client.encode(image_file(disc())).id
        for part in client.iter_points(object_id, n):
            assert len(part)
            break
        assert client.live().status == "live"

    async def leave() -> str:
        async with AsyncClient(url) as client:
            async with aclosing(client.iter_points(object_id, n)) as parts:
                async for part in parts:
                    assert len(part)
                    break
            return (await client.live()).status

    assert asyncio.run(leave()) == "live"
    until(lambda: runtime_of(colored_server).gates.points.held == 0)


def test_colored_points_have_the_colors_of_the_service(
    hof: Client, colored_server: Server, disc_object: StoredObject
) -> None:
    cloud = hof.colored_points(disc_object.id, N)
    assert cloud.colors is not None
    file = _file(colored_server, disc_object.id, n=N, format="ply")
    assert ply.head(N, colored=True) + ply.colored_body(cloud.points, cloud.colors) == file
    assert np.array_equal(cloud.points, hof.points(disc_object.id, N))


def test_colored_points_of_an_object_without_color_have_no_colors(connect: Open, server: Server, photo: bytes) -> None:
    client = connect(f"http://127.0.0.1:{server.port}")
    stored = client.encode(photo)
    cloud = client.colored_points(stored.id, 100)
    assert stored.color is None
    assert cloud.colors is None
    assert np.array_equal(cloud.points, client.points(stored.id, 100))


@pytest.mark.parametrize("name", ["ply", "npy", "xyz", "json", "glb", "gltf", "pcd", "f32", "f16"])
def test_save_points_writes_the_file_of_the_suffix(
    hof: Client, colored_server: Server, disc_object: StoredObject, tmp_path: Path, name: str
) -> None:
    path = hof.save_points(disc_object.id, tmp_path / f"disc.{name}", 1000)
    assert path.read_bytes() == _file(colored_server, disc_object.id, n=1000, format=name)
    assert list(tmp_path.iterdir()) == [path]


def test_save_points_to_an_unknown_suffix_is_refused(hof: Client, disc_object: StoredObject, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="give one of ply, npy"):
        hof.save_points(disc_object.id, tmp_path / "disc.stl")
    assert hof.save_points(disc_object.id, tmp_path / "disc.stl", 10, format="xyz").read_text().count("\n") == 10


def test_refused_points_leave_no_file(hof: Client, disc_object: StoredObject, tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter):
        hof.save_points(disc_object.id, tmp_path / "disc.json", 200_000)
    with pytest.raises(ValueError, match="n is 0"):
        hof.points(disc_object.id, 0)
    with pytest.raises(InvalidParameter, match="10000000"):
        hof.points(disc_object.id, 10_000_001)
    assert list(tmp_path.iterdir()) == []


def test_points_take_no_memory_beside_the_array() -> None:
    reader = PointArray(1_000_000, "<f4")
    piece = bytes(65_532)
    tracemalloc.start()
    for _ in range(100):
        reader.feed(piece)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * len(piece)


@settings(deadline=None)
@given(st.integers(1, 50), st.lists(st.integers(1, 60), max_size=30))
def test_points_do_not_depend_on_the_pieces_that_come(n: int, sizes: list[int]) -> None:
    points = np.random.default_rng(n).random((n, 3), np.float32)
    colors = np.random.default_rng(n).integers(0, 256, (n, 3), np.uint8)
    plain, colored = PointArray(n, "<f4"), ColoredArrays(n)
    for piece in _pieces(points.tobytes(), sizes):
        plain.feed(piece)
    for piece in _pieces(ply.head(n, colored=True) + ply.colored_body(points, colors), sizes):
        colored.feed(piece)
    assert np.array_equal(plain.result(), points)
    cloud = colored.result()
    assert cloud.colors is not None
    assert np.array_equal(cloud.points, points)
    assert np.array_equal(cloud.colors, colors)


def _pieces(data: bytes, sizes: list[int]) -> list[bytes]:
    ends = [0, *np.minimum(np.cumsum(sizes, dtype=int), len(data)).tolist(), len(data)]
    return [data[start:end] for start, end in itertools.pairwise(ends)]


@pytest.mark.parametrize("length", [0, 11, 12, 119])
def test_points_that_end_early_are_refused(length: int) -> None:
    reader = PointArray(10, "<f4")
    reader.feed(bytes(length))
    with pytest.raises(Truncated, match=f"after {length // 12} of 10 points"):
        reader.result()


def test_points_beyond_the_requested_number_are_refused() -> None:
    with pytest.raises(UnexpectedAnswer, match="more than the 10 points"):
        PointArray(10, "<f4").feed(bytes(121))


@pytest.mark.parametrize(
    "file",
    [
        b"ply\nformat ascii 1.0\nelement vertex 10\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        ply.head(11),
        ply.head(10).replace(b"float x", b"double x"),
        ply.head(10).replace(b"property float z\n", b""),
        b"<html>" + bytes(5000),
    ],
)
def test_file_that_is_not_the_ply_is_refused(file: bytes) -> None:
    with pytest.raises(UnexpectedAnswer, match="no PLY"):
        ColoredArrays(10).feed(file)


@pytest.mark.parametrize("file", [b"", ply.head(10)[:-1], ply.head(10) + bytes(119)])
def test_ply_that_ends_early_is_refused(file: bytes) -> None:
    reader = ColoredArrays(10)
    reader.feed(file)
    with pytest.raises(Truncated):
        reader.result()

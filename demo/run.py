"""Run the demo: start `hof serve`, send it the pictures of this folder, fetch points, draw both side by side.

Needs what the service needs and nothing more; the standard library talks HTTP.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from service.drawing.cloud import draw

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

HERE: Final = Path(__file__).resolve().parent
PICTURES: Final = (".png", ".jpg")
POINTS: Final = 20_000
START_TIMEOUT_S: Final = 60
REQUEST_TIMEOUT_S: Final = 60
SIDE: Final = 480  # pixels of a cell of the picture


def main() -> int:
    """Run the demo. Returns the exit status; an error is one line on stderr."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="folder to write; default: out/demo")
    out = parser.parse_args().out
    photos = sorted(path for path in HERE.iterdir() if path.suffix in PICTURES and path.stem != "demo")
    try:
        out.mkdir(parents=True, exist_ok=True)
        with serving() as address:
            rows = [row(photo, *lift(photo, address, out)) for photo in photos]
    except urllib.error.HTTPError as error:
        return fail(f"{error.url} answered {error.code}: {error.read().decode(errors='replace')}")
    except (OSError, RuntimeError) as error:
        return fail(str(error))
    Image.fromarray(np.concatenate(rows)).save(out / "demo.png", optimize=True)
    print(f"{out / 'demo.png'}: each photo beside {POINTS} points of its object")
    return 0


def fail(message: str) -> int:
    """Print an error; return the exit status."""
    print(f"demo: {message}", file=sys.stderr)
    return 1


@contextmanager
def serving() -> Iterator[str]:
    """Run `hof serve` on a free port with an empty store until the block ends; its address, once it is ready."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = str(probe.getsockname()[1])
    with tempfile.TemporaryDirectory() as folder:
        settings = {"DATABASE_URL": f"sqlite:///{folder}/hof.db", "LOG_LEVEL": "warning", "DRAIN_S": "0"}
        environment = {**os.environ, **{f"HOF_{name}": value for name, value in settings.items()}}
        hof = str(Path(sys.executable).with_name("hof"))  # of the environment that runs this
        server = subprocess.Popen([hof, "serve", "--host", "127.0.0.1", "--port", port], env=environment)  # noqa: S603
        try:
            wait_until_ready(server, f"http://127.0.0.1:{port}")
            yield f"http://127.0.0.1:{port}"
        finally:
            server.terminate()
            server.wait()


def wait_until_ready(server: subprocess.Popen[bytes], address: str) -> None:
    """Wait until /health/ready answers 200. Raises RuntimeError if the server ends or START_TIMEOUT_S pass."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        if server.poll() is not None:
            raise RuntimeError(f"hof serve ended with status {server.returncode}")
        try:
            request(f"{address}/health/ready")
        except OSError:  # refused, or 503: still starting
            time.sleep(0.1)
        else:
            return
    raise RuntimeError(f"hof serve was not ready after {START_TIMEOUT_S} s")


def request(url: str, body: bytes | None = None) -> bytes:
    """Send a GET, or a POST if there is a body; return the answer's body. Raises HTTPError for 4xx and 5xx."""
    call = urllib.request.Request(url, body, {"Content-Type": "application/octet-stream"})  # noqa: S310
    with urllib.request.urlopen(call, timeout=REQUEST_TIMEOUT_S) as answer:  # noqa: S310
        data: bytes = answer.read()
    return data


def lift(photo: Path, address: str, out: Path) -> tuple[Floats, Bytes | None]:
    """Encode a photo over HTTP, write its points as PLY and GLB, and return them, (n, 3), with their colors if any."""
    stored = json.loads(request(f"{address}/encode", photo.read_bytes()))
    files = {}
    for kind in ("ply", "glb"):
        path = out / f"{photo.stem}.{kind}"
        files[kind] = request(f"{address}{stored['links']['points']}?n={POINTS}&format={kind}")
        path.write_bytes(files[kind])
        print(f"{path}: {POINTS} points of {photo.name}, {len(files[kind])} bytes")
    _, _, body = files["ply"].partition(b"end_header\n")
    rows = np.frombuffer(body, np.uint8).reshape(POINTS, -1)  # x y z, float32; red green blue, a byte each
    return np.ascontiguousarray(rows[:, :12]).view("<f4"), rows[:, 12:] if stored.get("color") else None


def row(photo: Path, points: Floats, colors: Bytes | None) -> Bytes:
    """Draw a photo and its points side by side, (SIDE, 2 * SIDE, 3)."""
    cell = Image.new("RGBA", (SIDE, SIDE), "white")
    picture = Image.open(photo).convert("RGBA")
    scale = 0.9 * SIDE / max(picture.size)
    picture = picture.resize((round(picture.width * scale), round(picture.height * scale)))
    cell.alpha_composite(picture, ((SIDE - picture.width) // 2, (SIDE - picture.height) // 2))
    return np.concatenate([np.asarray(cell.convert("RGB")), draw(points, SIDE, colors=colors)], axis=1)


if __name__ == "__main__":
    sys.exit(main())

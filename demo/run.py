"""Run the demo: start `hof serve`, send it the photos of this folder, save points and a picture of each object.

Needs what the service needs and nothing more; the standard library talks HTTP.
"""

import argparse
import io
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from PIL import Image

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
            pictures = [lift(photo, address, out) for photo in photos]
    except urllib.error.HTTPError as error:
        return fail(f"{error.url} answered {error.code}: {error.read().decode(errors='replace')}")
    except (OSError, RuntimeError) as error:
        return fail(str(error))
    side_by_side(photos, pictures).save(out / "demo.png", optimize=True)
    print(f"{out / 'demo.png'}: each photo beside its object")
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


def lift(photo: Path, address: str, out: Path) -> Image.Image:
    """Encode a photo over HTTP, write points of its object as PLY and GLB, and return the service's picture of it."""
    stored = json.loads(request(f"{address}/encode", photo.read_bytes()))
    for kind in ("ply", "glb"):
        path = out / f"{photo.stem}.{kind}"
        content = request(f"{address}{stored['links']['points']}?n={POINTS}&format={kind}")
        path.write_bytes(content)
        print(f"{path}: {POINTS} points of {photo.name}, {len(content)} bytes")
    return Image.open(io.BytesIO(request(f"{address}{stored['links']['self']}/picture?size={SIDE}&format=png")))


def side_by_side(photos: Sequence[Path], pictures: Sequence[Image.Image]) -> Image.Image:
    """Return each photo beside the picture of its object, a row each."""
    sheet = Image.new("RGB", (2 * SIDE, SIDE * len(photos)), "white")
    for number, (path, picture) in enumerate(zip(photos, pictures, strict=True)):
        photo = Image.open(path).convert("RGBA")
        scale = 0.9 * SIDE / max(photo.size)
        photo = photo.resize((round(photo.width * scale), round(photo.height * scale)))
        left, top = (SIDE - photo.width) // 2, (SIDE - photo.height) // 2
        sheet.paste(photo, (left, number * SIDE + top), photo)
        sheet.paste(picture, (SIDE, number * SIDE))
    return sheet


if __name__ == "__main__":
    sys.exit(main())

"""The package's own tests, run by Node; those of calls against the service."""

from pathlib import Path

import pytest

from tests.client.js.conftest import Run
from tests.support.photos import disc, image_file
from tests.support.server import Server

pytestmark = pytest.mark.system


def test_calls_of_the_service_work_in_node(npm: Run, built: Path, colored_server: Server, tmp_path: Path) -> None:
    photo = tmp_path / "disc.png"
    photo.write_bytes(image_file(disc()))
    address = f"http://127.0.0.1:{colored_server.port}"
    assert "# fail 0" in npm("node", "--test", "test/service.test.js", HOF_URL=address, PHOTO=str(photo))


def test_calls_are_repeated_and_fail_as_documented(npm: Run, built: Path) -> None:
    assert "# fail 0" in npm("node", "--test", "test/repeats.test.js")


def test_functions_drawn_in_node_are_the_points_of_the_service(
    npm: Run, built: Path, colored_server: Server, tmp_path: Path
) -> None:
    photo = tmp_path / "disc.png"
    photo.write_bytes(image_file(disc()))
    address = f"http://127.0.0.1:{colored_server.port}"
    assert "# fail 0" in npm("node", "--test", "test/sample.test.js", HOF_URL=address, PHOTO=str(photo))

"""The `hof` command: offline commands give what the service gives; flags and errors."""

import json
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.cli.main import main
from service.formats.mesh.registry import MESH_FORMATS
from service.formats.points.registry import POINT_FORMATS
from service.formats.weights import Weights, dump, load
from service.mapping.spec import MappingSpec, initial_theta
from tests.support.photos import disc, image_file
from tests.support.small import model as tiny_model


@pytest.mark.parametrize("name", POINT_FORMATS)
def test_encode_writes_the_bytes_that_the_service_serves(here: Path, client: httpx.Client, name: str) -> None:
    assert main(["encode", "photo.png", "-o", f"out.{name}", "--n", "5000", "--seed", "3", "--scale", "2"]) == 0
    link = client.post("/encode", content=(here / "photo.png").read_bytes()).json()["links"]["points"]
    served = client.get(link, params={"n": 5000, "seed": 3, "scale": 2, "format": name})
    assert (here / f"out.{name}").read_bytes() == served.content


def test_sample_of_encoded_weights_equals_encoded_points(here: Path) -> None:
    assert main(["encode", "photo.png", "-o", "out.safetensors"]) == 0
    assert main(["sample", "out.safetensors", "-o", "sampled.npy", "--n", "100"]) == 0
    assert main(["encode", "photo.png", "-o", "encoded.npy", "--n", "100"]) == 0
    assert np.load("sampled.npy").shape == (100, 3)
    assert (here / "sampled.npy").read_bytes() == (here / "encoded.npy").read_bytes()


def test_encode_with_a_label_names_the_object_that_the_service_imports(
    here: Path, client: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["encode", "photo.png", "-o", "plain.safetensors"]) == 0
    assert main(["encode", "photo.png", "-o", "named.safetensors", "--label", " Desk chair "]) == 0
    named = (here / "named.safetensors").read_bytes()
    assert load(named).label == "Desk chair"
    assert load((here / "plain.safetensors").read_bytes()).label is None
    answer = client.post("/objects", content=named)
    assert (answer.status_code, answer.json()["label"]) == (201, "Desk chair")
    assert main(["encode", "photo.png", "-o", "out.ply", "--label", "Desk chair"]) == 2
    assert "only a weights file has a label" in capsys.readouterr().err
    assert main(["encode", "photo.png", "-o", "out.safetensors", "--label", "two\nlines"]) == 2
    assert "one line" in capsys.readouterr().err


def test_encode_with_framing_options_changes_theta(here: Path) -> None:
    options: list[list[str]] = [[], ["--background", "keep"], ["--foreground-ratio", "0.5"]]
    for index, extra in enumerate(options):
        assert main(["encode", "photo.png", "-o", f"{index}.safetensors", *extra]) == 0
    thetas = [load((here / f"{index}.safetensors").read_bytes()).theta.tobytes() for index in range(3)]
    assert len(set(thetas)) == 3


def test_encode_with_matting_removes_the_background(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    photo = str(Path(__file__).parents[3] / "demo" / "coffee.jpg")
    assert main(["encode", photo, "-o", "whole.safetensors"]) == 0
    assert main(["encode", photo, "-o", "refused.safetensors", "--background", "remove"]) == 2
    monkeypatch.delenv("HOF_MATTING_MODEL")
    assert main(["encode", photo, "-o", "object.safetensors", "--background", "remove"]) == 0
    thetas = [load((here / f"{name}.safetensors").read_bytes()).theta for name in ("whole", "object")]
    assert np.abs(thetas[0] - thetas[1]).max() > 1e-3


def _two_objects(here: Path) -> list[Path]:
    for name, color in (("a", "red"), ("b", "green")):
        (here / f"{name}.png").write_bytes(image_file(disc(color)))
        assert main(["encode", f"{name}.png", "-o", f"{name}.safetensors"]) == 0
    return [here / "a.safetensors", here / "b.safetensors"]


def test_compose_writes_the_points_that_the_service_serves(here: Path, client: httpx.Client) -> None:
    ids = [client.post("/objects", content=path.read_bytes()).json()["id"] for path in _two_objects(here)]
    links = client.post("/compose", json={"objects": ids}).json()["links"]
    for suffix in ("ply", "glb"):
        assert (
            main(["compose", "a.safetensors", "b.safetensors", "-o", f"ab.{suffix}", "--n", "5000", "--seed", "3"]) == 0
        )
        served = client.get(links["points"], params={"n": 5000, "seed": 3, "format": suffix})
        assert (here / f"ab.{suffix}").read_bytes() == served.content
    assert main(["compose", "b.safetensors", "a.safetensors", "-o", "ba.ply", "--n", "5000", "--seed", "3"]) == 0
    assert (here / "ab.ply").read_bytes() != (here / "ba.ply").read_bytes()


def test_sample_and_info_of_composed_weights_use_the_word(
    here: Path, client: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    ids = [client.post("/objects", content=path.read_bytes()).json()["id"] for path in _two_objects(here)]
    links = client.post("/compose", json={"objects": ids}).json()["links"]
    (here / "ab.safetensors").write_bytes(client.get(links["weights"]).content)
    assert main(["sample", "ab.safetensors", "-o", "ab.ply", "--n", "500"]) == 0
    assert (here / "ab.ply").read_bytes() == client.get(links["points"], params={"n": 500}).content
    capsys.readouterr()
    assert main(["info", "ab.safetensors"]) == 0
    assert json.loads(capsys.readouterr().out)["word"] == ids
    assert main(["compose", "a.safetensors", "ab.safetensors", "-o", "out.ply"]) == 2
    assert "ab.safetensors is composed" in capsys.readouterr().err


@pytest.mark.parametrize("name", MESH_FORMATS)
def test_mesh_writes_the_surface_that_the_service_serves(here: Path, client: httpx.Client, name: str) -> None:
    assert main(["encode", "photo.png", "-o", "object.safetensors"]) == 0
    assert main(["mesh", "object.safetensors", "-o", f"object.{name}", "--resolution", "8", "--scale", "2"]) == 0
    links = client.post("/objects", content=(here / "object.safetensors").read_bytes()).json()["links"]
    served = client.get(links["mesh"], params={"format": name, "resolution": 8, "scale": 2})
    assert (here / f"object.{name}").read_bytes() == served.content


def test_compose_of_files_that_form_no_word_is_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _two_objects(here)
    capsys.readouterr()  # reports of the photos
    spec = MappingSpec("tiny", 3, (16,), 3, k=3)
    (here / "c.safetensors").write_bytes(dump(Weights(spec, initial_theta(spec), "m"), "safetensors"))
    for names, message in (
        ("a", "a word needs k = 2 objects, not 1"),
        ("a b a", "a word needs k = 2 objects, not 3"),
        ("a c", "c.safetensors has the k 3, a.safetensors 2: specs must be equal"),
        ("a d", "d.safetensors: No such file or directory"),
    ):
        assert main(["compose", *(f"{name}.safetensors" for name in names.split()), "-o", "out.ply"]) == 2
        assert capsys.readouterr().err == f"hof: {message}\n"
    assert not (here / "out.ply").exists()


def test_openapi_prints_the_committed_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["openapi"]) == 0
    assert capsys.readouterr().out == (Path(__file__).parents[3] / "openapi.json").read_text()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("encode photo.png -o out.stl", "out.stl: no format has the suffix '.stl'"),
        ("encode photo.png -o out", "no format has the suffix ''"),
        ("encode photo.png -o nowhere/out.ply", "No such file or directory"),
        ("encode nothere.png -o out.ply", "nothere.png: No such file or directory"),
        ("encode text.png -o out.ply", "not a PNG, JPEG, WebP, AVIF or HEIC"),
        ("encode cut.png -o out.ply", "hof: cut.png: "),
        ("encode cut.png -o out.ply", "truncated or corrupt"),
        ("encode photo.png -o -", "stdout has no suffix: name the format with --format, one of ply, npy"),
        ("encode photo.png -o out.ply --frame x", "frame: "),
        ("encode photo.png -o out.ply --max-image-pixels 99", "limit is 99 (HOF_MAX_IMAGE_PIXELS, --max-image-pixels)"),
        ("encode photo.png -o out.ply --n 0", "n: Input should be greater than or equal to 1"),
        ("encode photo.png -o out.ply --n x", "n: Input should be a valid integer"),
        ("encode photo.png -o out.json --n 100001", "json holds at most 100000 points"),
        ("encode photo.png -o out.ply --seed -1", "seed: "),
        ("encode photo.png -o out.ply --foreground-ratio 2", "foreground_ratio: "),
        ("encode photo.png -o out.ply --threads 0", "threads: "),
        ("encode photo.png -o out.ply --model nothere.onnx", "nothere.onnx"),
        ("encode photo.png -o out.ply --model photo.png", "photo.png is unusable"),
        ("sample nothere.safetensors -o out.ply", "nothere.safetensors"),
        ("sample photo.png -o out.ply", "hof: photo.png: "),
        ("compose photo.png photo.png -o out.ply", "hof: photo.png: "),
        ("compose photo.png -o out.stl", "no format has the suffix"),
        ("compose a.safetensors -o out.png", "all words (mode all) are made of two objects, not 1"),
        (
            "compose a.safetensors a.safetensors -o out.png --n 100001",
            "n is 100001; a picture shows at most 100000 points per word",
        ),
        ("compose a.safetensors a.safetensors -o out.png --scale 2", "scale is 2; a picture has no scale"),
        ("sample photo.png -o out.safetensors", "no format has the suffix"),
        (
            "mesh photo.png -o out.npy",
            "out.npy: no format has the suffix '.npy'; use one of .glb, .gltf, .obj, .stl, .ply, .usdz",
        ),
        ("mesh photo.png -o out.stl", "hof: photo.png: "),
        ("mesh photo.png -o out.stl --resolution 1000", "resolution: "),
        ("info photo.png", "hof: photo.png: "),
        ("serve --port 70000", "port: "),
        ("serve --model nothere.onnx", "nothere.onnx"),
        ("serve --model tiny.onnx --model tiny.onnx", "tiny.onnx and tiny.onnx are both named tiny-k2: load one"),
        ("serve --matting-model nothere.onnx", "cannot read the matting model nothere.onnx: No such file"),
        ("encode photo.png -o out.ply --matting-model photo.png", "the matting model photo.png is unusable"),
        ("serve --api-keys-file nothere", "cannot read the keys file nothere: No such file"),
        ("serve --api-keys-file text.png", "line 1 of the keys file text.png is malformed"),
        ("serve --metrics key", "--metrics is key, but there is no keys file"),
        ("serve --rate-limit often", "--rate-limit: "),
        ("serve --cors-origins shop.example", "--cors-origins: "),
        ("serve --workers 0", "workers: "),
        ("key a/b --scope read", "a key's name has 1 to 64 letters"),
        ("doctor --threads 0", "threads: "),
        ("serve --database-url nonsense", "invalid database URL; expected sqlite:///PATH"),
        ("serve --database-url nosuch://user:secret@db/x", "invalid database URL; expected sqlite:///PATH"),
        ("serve --database-url sqlite://", "sqlite:// is a database in memory"),
        ("serve --database-url sqlite:///:memory:", "name a file: sqlite:///PATH"),
        ("serve --database-url sqlite:///file:x?mode=memory&uri=true", "name a file: sqlite:///PATH"),
        ("serve --database-url sqlite:///photo.png", "cannot open the database sqlite:///photo.png: file is not"),
        ("serve --database-url sqlite:///photo.png/hof.db", "cannot open the database sqlite:///photo.png/hof.db"),
        ("serve --database-url postgresql://u:secret@127.0.0.1:1/x", "cannot open the database postgresql://u:***@"),
    ],
)
def test_hof_with_wrong_arguments_prints_one_line_and_writes_no_file(
    here: Path, capsys: pytest.CaptureFixture[str], command: str, message: str
) -> None:
    (here / "text.png").write_text("no image")
    tiny_model.build(here / "tiny.onnx")
    weights = Weights(tiny_model.SPEC, initial_theta(tiny_model.SPEC), "m")
    (here / "a.safetensors").write_bytes(dump(weights, "safetensors"))
    (here / "cut.png").write_bytes((here / "photo.png").read_bytes()[:100])
    before = sorted(here.iterdir())
    assert main(command.split()) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("hof: ")
    assert captured.err.count("\n") == 1
    assert message in captured.err
    assert "secret" not in captured.err
    assert sorted(here.iterdir()) == before


def test_encode_with_an_option_out_of_range_names_field_limit_and_value(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["encode", "photo.png", "-o", "out.ply", "--n", "10000001"]) == 2
    assert capsys.readouterr().err == "hof: n: Input should be less than or equal to 10000000, not '10000001'\n"


def test_encode_with_a_failing_write_keeps_the_old_file(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "out.ply").write_text("old")

    def broken(*_: object) -> object:
        yield b"half"
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("service.cli.files.write", broken)
    before = sorted(here.iterdir())
    assert main(["encode", "photo.png", "-o", "out.ply"]) == 2
    assert sorted(here.iterdir()) == before
    assert (here / "out.ply").read_text() == "old"


def test_hof_without_a_command_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([])
    assert "COMMAND" in capsys.readouterr().err

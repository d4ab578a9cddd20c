"""`hof encode-many s3://...`, against a real S3 server over a socket."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from service.cli.main import main
from service.runtime.bulk import encoding, s3, workers
from service.runtime.bulk.photos import Setup, encode_photos
from service.runtime.bulk.pieces import Pieces
from service.storage.transfer.table import Item
from tests.support.photos import disc, image_file
from tests.support.systems.s3 import S3, running_s3, server_of_pairs, server_without_lists

PHOTOS = ("photos/b c%20ü.png", "photos/d.JPG", "photos/2024/a.png", "photos/2024/z/q.png")
OTHERS = ("photos/notes.txt", "photos/.hidden.png", "photos/.cache/x.png", "other/x.png", "photos.png")


def _forget() -> None:
    """Let the next test begin as a new process does."""
    s3._filesystem.cache_clear()
    s3._known.cache_clear()


@pytest.fixture(scope="module")
def server() -> Iterator[S3]:
    with running_s3() as server:
        yield server


@pytest.fixture
def bucket(server: S3, model_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[S3]:
    """Fill the bucket `shop`; the commands find it by their environment. The working folder is empty."""
    server.create("shop")
    for number, name in enumerate((*PHOTOS, *OTHERS)):
        server.put(f"shop/{name}", image_file(disc(("red", "green", "blue", "navy")[number % 4])))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOF_MODEL", str(model_path))
    monkeypatch.setenv("AWS_ENDPOINT_URL", server.url)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    _forget()
    yield server
    _forget()
    server.reset()


def _encode(*arguments: str) -> int:
    return main(["encode-many", *arguments, "-o", "objects.parquet", "--processes", "1"])


def _rows() -> dict[str, dict[str, object]]:
    return {row["source"]: row for row in pq.read_table("objects.parquet").to_pylist()}


@pytest.mark.usefixtures("bucket")
def test_encode_many_of_a_folder_in_s3_gives_the_rows_of_the_same_files(tmp_path: Path) -> None:
    assert _encode("s3://shop/photos") == 0
    rows = _rows()
    assert list(rows) == [f"s3://shop/{name}" for name in PHOTOS]
    assert all(row["error"] is None for row in rows.values())
    local = tmp_path / "local"
    for number, name in enumerate(PHOTOS):
        (local / name).parent.mkdir(parents=True, exist_ok=True)
        (local / name).write_bytes(image_file(disc(("red", "green", "blue", "navy")[number])))
    os.rename("objects.parquet", "from_s3.parquet")
    assert _encode("local/photos") == 0
    assert [row["id"] for row in _rows().values()] == [row["id"] for row in rows.values()]


@pytest.mark.usefixtures("bucket")
def test_encode_many_without_keys_reads_a_public_bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    monkeypatch.setenv("HOME", str(tmp_path))  # without ~/.aws
    assert _encode("s3://shop/photos/2024/a.png") == 0
    assert list(_rows()) == ["s3://shop/photos/2024/a.png"]


@pytest.mark.usefixtures("bucket")
def test_encode_many_of_a_scheme_in_capitals_reads_the_bucket() -> None:
    assert _encode("S3://shop/photos/2024") == 0
    assert list(_rows()) == [f"s3://shop/{name}" for name in PHOTOS if name.startswith("photos/2024/")]


def test_encode_many_of_a_list_with_urls_keeps_bad_photos_as_rows(bucket: S3) -> None:
    bucket.put("shop/photos/bad.png", b"no photo")
    names = ["s3://shop/photos/bad.png", "s3://shop/photos/d.JPG", "s3://shop/photos/gone.png"]
    Path("list.txt").write_text("\n".join(names), "utf-8")
    assert _encode("list.txt") == 0
    bad, good, gone = _rows().values()
    assert (bad["id"], good["error"], gone["id"]) == (None, None, None)
    assert "image" in str(bad["error"])
    assert gone["error"] == "s3://shop/photos/gone.png: there is no such object"


@pytest.mark.parametrize(("key", "folder"), [("photos//a.png", "shop/photos"), ("/a.png", "shop")])
def test_encode_many_of_a_folder_with_keys_with_an_empty_part_ends_with_an_error(
    bucket: S3, capsys: pytest.CaptureFixture[str], key: str, folder: str
) -> None:
    bucket.put(f"shop/{key}", image_file(disc("red")))
    assert _encode("s3://shop") == 2
    assert f"hof: s3://{folder}: keys that begin with s3://{folder}// cannot be read" in capsys.readouterr().err


@pytest.mark.usefixtures("bucket")
def test_encode_many_of_a_list_with_malformed_urls_keeps_them_as_rows_without_keys() -> None:
    names = ["s3://key:hun/ter2@shop/photos/d.JPG", "s3://shop/photos/", "s3://shop", "s3://shop/photos//d.JPG"]
    Path("list.txt").write_bytes("\n".join(names).encode() + b"\ns3://\xff/a.png\ns3://shop/\xff.png")
    assert _encode("list.txt") == 0
    rows = _rows()
    assert list(rows) == ["s3://***@shop/photos/d.JPG", *names[1:], "s3://\\xff/a.png", "s3://shop/\\xff.png"]
    keys, folder, whole, empty, *_ = [str(row["error"]) for row in rows.values()]
    assert keys.startswith("s3://***@shop/photos/d.JPG: a bucket's name has only")
    assert folder == "s3://shop/photos/: this is a bucket or a folder, not a photo"
    assert whole == "s3://shop: this is a bucket or a folder, not a photo"
    assert empty.startswith("s3://shop/photos//d.JPG: keys with an empty part")
    assert all(row["id"] is None for row in rows.values())


@pytest.mark.usefixtures("bucket")
def test_encode_many_of_a_list_with_a_bucket_that_does_not_exist_ends_with_an_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("list.txt").write_text("s3://shop/photos/d.JPG\ns3://none/photos/d.JPG")
    assert _encode("list.txt") == 2
    assert "hof: s3://none/photos/d.JPG: The specified bucket does not exist" in capsys.readouterr().err


def test_encode_many_that_loses_its_keys_ends_with_an_error_and_continues_later(
    bucket: S3, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoding, "PIECE_ROWS", 2)
    monkeypatch.setattr(workers, "JOB_PHOTOS", 1)
    monkeypatch.setattr(workers, "JOBS_AHEAD", 1)
    write = Pieces.write

    def refuse_after(pieces: Pieces, number: int, items: object) -> None:
        write(pieces, number, items)  # type: ignore[arg-type]
        bucket.require_keys()

    names = [f"s3://shop/{name}" for name in PHOTOS] * 3  # more than are read ahead
    Path("list.txt").write_text("\n".join(names), "utf-8")
    monkeypatch.setattr(Pieces, "write", refuse_after)
    assert _encode("list.txt") == 2
    message = capsys.readouterr().err
    assert "ACCESS_DENIED" in message
    assert "AWS_ACCESS_KEY_ID" in message
    assert "run the same command to continue" in message
    assert len(list(Path("objects.parquet.pieces").glob("*.parquet"))) >= 1
    monkeypatch.setattr(Pieces, "write", write)
    bucket.reset()
    bucket.create("shop")
    for name in PHOTOS:
        bucket.put(f"shop/{name}", image_file(disc("red")))
    assert _encode("list.txt") == 0
    assert pq.read_table("objects.parquet")["error"].null_count == len(names)


def _encode_from(server: str, model: Path, names: Sequence[str], monkeypatch: pytest.MonkeyPatch) -> list[Item]:
    """Encode objects of another server in this process."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", server)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    _forget()
    try:
        setup = Setup(model, None, "auto", None, 200_000, 1_000_000)
        return encode_photos(setup, [f"s3://{name}" for name in names])
    finally:
        _forget()


def test_photos_in_s3_are_read_at_the_same_time(model_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [f"shop/{number}.png" for number in range(8)]
    with server_of_pairs(image_file(disc("red"))) as url:
        rows = _encode_from(url, model_path, names, monkeypatch)
    assert [row.error for row in rows] == [None] * 8


def test_objects_denied_to_keys_that_may_not_list_are_rows_beside_one_that_is_read(
    model_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ["shop/gone.png", "shop/cold.png", "shop/good.png"]
    with server_without_lists(image_file(disc("red")), {"shop/good.png"}, {"shop/cold.png"}) as url:
        gone, cold, good = _encode_from(url, model_path, names, monkeypatch)
        with pytest.raises(ConnectionError, match="ACCESS_DENIED"):
            _encode_from(url, model_path, names[:1], monkeypatch)
    assert gone.error
    assert gone.error.startswith("s3://shop/gone.png: ")
    assert "ACCESS_DENIED" in gone.error
    assert cold.error
    assert cold.error.startswith("s3://shop/cold.png: no (")
    assert good.entry


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("s3://none/photos", "hof: s3://none/photos: The specified bucket does not exist (NO_SUCH_BUCKET); check the"),
        ("s3://shop/none", "hof: s3://shop/none: there is no such folder or object"),
        ("s3://shop/photos/*.png", "patterns are for local files"),
        ("s3://", "lacks the bucket's name"),
        ("s3:///photos", "lacks the bucket's name"),
        ("s3://my bucket/x", "hof: s3://my bucket/x: a bucket's name has only"),
        ("s3://shop%zz/x", "hof: s3://shop%zz/x: a bucket's name has only"),
        ("s3://shop?x=1", "hof: s3://shop?x=1: a bucket's name has only"),
        ("s3://key:hun/ter2@shop/photos", "hof: s3://***@shop/photos: a bucket's name has only"),
        ("s3://key:hun/ter2", "hof: s3://key:***: a bucket's name has only"),
        ("s3://shop//photos", "hof: s3://shop//photos: keys with an empty part (//) cannot be read"),
        ("s3://shop/photos/notes.txt", "there are no photos"),
    ],
)
@pytest.mark.usefixtures("bucket")
def test_encode_many_of_what_is_not_in_s3_ends_with_one_error(
    capsys: pytest.CaptureFixture[str], source: str, message: str
) -> None:
    assert _encode(source) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "ter2" not in error
    assert error.count("\n") == 1
    assert not list(Path().iterdir())


def test_encode_many_with_refused_keys_ends_with_one_error(bucket: S3, capsys: pytest.CaptureFixture[str]) -> None:
    bucket.require_keys()
    assert _encode("s3://shop/photos") == 2
    error = capsys.readouterr().err
    assert "does not exist in our records (INVALID_ACCESS_KEY_ID); check" in error
    assert error.count("\n") == 1


@pytest.mark.usefixtures("bucket")
def test_encode_many_without_a_server_ends_with_one_error(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    assert _encode("s3://shop/photos") == 2
    assert "NETWORK_CONNECTION" in capsys.readouterr().err


@pytest.mark.usefixtures("bucket")
@pytest.mark.parametrize("scheme", ["s3", "S3"])
def test_encode_many_to_s3_is_refused(scheme: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["encode-many", "s3://shop/photos", "-o", f"{scheme}://shop/objects.parquet"]) == 2
    assert "the output has to be a local file" in capsys.readouterr().err

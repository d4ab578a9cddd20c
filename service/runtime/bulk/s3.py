"""Photos in S3 or another server with its protocol: listed a folder at a time, read one by one.

Keys and server come from where Amazon's tools take them: `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY` or `~/.aws`,
and `AWS_ENDPOINT_URL`. Without keys, calls are anonymous.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final

from service.errors import InvalidParameter

SCHEME: Final = "s3://"
AWS_ERROR: Final = re.compile(
    r"AWS Error (?P<code>\w+) during \w+ operation: (?P<text>.*?)(?: \(Request ID: .*)?$", re.DOTALL
)
OF_ONE_OBJECT: Final = ("ACCESS_DENIED", "NO_SUCH_KEY", "OBJECT_NOT_IN_ACTIVE_TIER")  # perhaps: the bucket tells
HELP: Final = (
    "check the bucket's name, the keys (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY) and the server (AWS_ENDPOINT_URL)"
)


def is_url(source: str) -> bool:
    """Return whether a source is in S3."""
    return source.startswith(SCHEME)


def files_of(url: str) -> Iterator[str]:
    """Yield the URLs of the objects in a folder or a bucket and its subfolders, or that of one object; in fixed order.

    Names that begin with a dot are left out. Memory holds one folder.

    Raises
    ------
    InvalidParameter : there is no such folder or object.
    ConnectionError : there is no such bucket, the keys are refused, or the server does not answer.
    """
    try:
        yield from _files(url, url.removeprefix(SCHEME).rstrip("/"))
    except OSError as error:
        raise ConnectionError(f"{url}: {_reason(error)}; {HELP}") from error


def _files(url: str, path: str) -> Iterator[str]:
    from pyarrow.fs import FileSelector, FileType

    filesystem, folders = _filesystem(_bucket(path)), [path]
    while folders:
        try:
            entries = filesystem.get_file_info(FileSelector(folder := folders.pop()))
        except FileNotFoundError as error:  # no folder, or one that was removed meanwhile
            if folder == path != _bucket(path) and filesystem.get_file_info(path).type == FileType.File:
                yield url
            elif folder == path:
                raise InvalidParameter(
                    f"{url}: there is no such folder or object; patterns are for local files"
                ) from error
            continue
        entries = sorted(
            (each for each in entries if not each.base_name.startswith(".")), key=lambda each: str(each.path)
        )
        yield from (SCHEME + each.path for each in entries if each.type == FileType.File)
        folders += [each.path for each in reversed(entries) if each.type == FileType.Directory]


def read(url: str, limit: int) -> bytes:
    """Return the first `limit` bytes of an object.

    Raises
    ------
    FileNotFoundError, PermissionError : the object is gone, or only it cannot be read.
    ConnectionError : no object can be read: the keys are refused, or the server does not answer.
    """
    path = url.removeprefix(SCHEME)
    try:
        with _filesystem(_bucket(path)).open_input_stream(path) as file:
            data: bytes = file.read(limit)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{url}: there is no such object") from error
    except OSError as error:
        if _code(error) in OF_ONE_OBJECT and _answers(_bucket(path)):
            raise PermissionError(f"{url}: {_reason(error)}") from error
        raise ConnectionError(f"{url}: {_reason(error)}; {HELP}, then run the same command to continue") from error
    return data


@lru_cache(8)
def _filesystem(bucket: str) -> Any:  # noqa: ANN401 - pyarrow has no types
    """Return the file system of a bucket, in its region. Raises OSError."""
    from pyarrow.fs import FileSystem

    if not bucket:
        raise InvalidParameter(f"{SCHEME} lacks the bucket's name: write {SCHEME}BUCKET/FOLDER")
    return FileSystem.from_uri(SCHEME + bucket)[0]


def _bucket(path: str) -> str:
    return path.partition("/")[0]


def _answers(bucket: str) -> bool:
    """Return whether the keys may use a bucket."""
    try:
        _filesystem(bucket).get_file_info(bucket)
    except OSError:
        return False
    return True


def _code(error: OSError) -> str:
    match = AWS_ERROR.search(str(error))
    return match["code"] if match else ""


def _reason(error: OSError) -> str:
    """Return the server's reason without pyarrow's frame."""
    match = AWS_ERROR.search(str(error))
    return f"{match['text'].strip().rstrip('.') or 'no reason'} ({match['code']})" if match else str(error)

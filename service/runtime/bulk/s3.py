"""Photos in S3 or another server with its protocol: listed a folder at a time, read one by one.

Keys and server come from where Amazon's tools take them: `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY` or `~/.aws`,
and `AWS_ENDPOINT_URL`. Without keys, calls are anonymous.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from threading import Lock
from typing import Any, Final

from service.errors import InvalidParameter

SCHEME: Final = "s3://"
BUCKET_NAME: Final = re.compile(r"[A-Za-z0-9._-]+")
AWS_ERROR: Final = re.compile(
    r"AWS Error (?P<code>[^:]+?) during \w+ operation: (?P<text>.*?)(?: \(Request ID: .*)?$", re.DOTALL
)
DENIED: Final = "ACCESS_DENIED"
# Codes of errors that concern one object, perhaps: the bucket tells. pyarrow prints those that it has no name for, such
# as that of an archived object, as a number; UNKNOWN is an answer to HEAD, which has no body.
OF_ONE_OBJECT: Final = re.compile(
    rf"{DENIED}|NO_SUCH_KEY|INVALID_OBJECT_STATE|OBJECT_NOT_IN_ACTIVE_TIER|\[code \d+\]|UNKNOWN \(HTTP status 40[03]\)"
)
LOOKUP: Final = Lock()  # readers on several threads share what they learn of a bucket
ABSENT: Final = ".hof-absent"  # folder that no bucket has: listing it is cheap, and its errors have a body
HELP: Final = (
    "check the bucket's name, the keys (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY) and the server (AWS_ENDPOINT_URL)"
)


def is_url(source: str) -> bool:
    """Return whether a source is in S3. Its scheme may have any case."""
    return source[: len(SCHEME)].lower() == SCHEME


def masked(url: str) -> str:
    """Return a URL without the keys that somebody wrote before the bucket's name: they are refused there."""
    path = url[len(SCHEME) :]
    if not re.search("[:@]", _bucket(path)):
        return url
    _, at, rest = path.rpartition("@")  # a secret key may contain slashes
    return f"{SCHEME}***@{rest}" if at else f"{SCHEME}{rest.partition(':')[0]}:***"


def files_of(url: str) -> Iterator[str]:
    """Yield the URLs of the objects in a folder or a bucket and its subfolders, or that of one object; in fixed order.

    Names that begin with a dot are left out. Memory holds one folder.

    Raises
    ------
    InvalidParameter : the URL is malformed, there is no such folder or object, or keys have an empty part.
    ConnectionError : there is no such bucket, the keys are refused, or the server does not answer.
    """
    path = _path(url).rstrip("/")
    try:
        yield from _files(url, path)
    except ValueError as error:
        raise InvalidParameter(f"{url}: {error}") from error
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
                yield SCHEME + path
            elif folder == path:
                raise InvalidParameter(
                    f"{url}: there is no such folder or object; patterns are for local files"
                ) from error
            continue
        _check_inside(folder, [each.path for each in entries])
        entries = sorted(
            (each for each in entries if not each.base_name.startswith(".")), key=lambda each: str(each.path)
        )
        yield from (SCHEME + each.path for each in entries if each.type == FileType.File)
        folders += [each.path for each in reversed(entries) if each.type == FileType.Directory]


def _check_inside(folder: str, paths: list[str]) -> None:
    """Raise InvalidParameter for keys such as `photos//a.png`.

    pyarrow lists `photos//` in `photos` as `photos` itself, and cannot open such objects.
    """
    if not all(path.startswith(f"{folder}/") and path != f"{folder}/" for path in paths):
        raise InvalidParameter(
            f"{SCHEME}{folder}: keys that begin with {SCHEME}{folder}// cannot be read, for they have an empty part; "
            "rename these objects, or name other folders or photos"
        )


def read(url: str, limit: int) -> bytes:
    """Return the first `limit` bytes of an object.

    Raises
    ------
    InvalidParameter : the URL is malformed, or names a folder.
    FileNotFoundError, PermissionError : the object is gone, or only it cannot be read.
    ConnectionError : no object can be read: there is no such bucket, the keys are refused, or the server does not
        answer.
    """
    path = _path(url)
    if "/" not in path or path.endswith("/"):
        raise InvalidParameter(f"{url}: this is a bucket or a folder, not a photo")
    with LOOKUP:
        bucket = _known(_bucket(path))
    try:
        return bucket.read(path, limit)
    except ValueError as error:
        raise InvalidParameter(f"{url}: {error}") from error
    except OSError as error:
        if fault := bucket.fault(error):
            advice = f"{HELP}, then run the same command to continue"
            raise ConnectionError(f"{url}: {_reason(fault)}; {advice}") from error
        if isinstance(error, FileNotFoundError):
            raise FileNotFoundError(f"{url}: there is no such object") from error
        raise PermissionError(f"{url}: {_reason(error)}") from error


class _Bucket:
    """A bucket, and what this process has learned of it."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._exists = False
        self._is_readable = False  # with these keys

    def read(self, path: str, limit: int) -> bytes:
        """Return the first bytes of an object. Raises OSError and ValueError."""
        with _filesystem(self._name).open_input_file(path) as file:
            # pyarrow writes a refusal into the same memory, and parses what follows it, too. Zeros end it.
            data = bytearray(min(file.size(), limit))
            length = file.readinto(data)
        self._exists = self._is_readable = True
        return bytes(data[:length])

    def fault(self, error: OSError) -> OSError | None:
        """Return why no object can be read, or None if the error of a read concerns one object.

        Amazon's servers answer "denied" to keys that may not list the bucket and ask for a missing object. They answer
        the same to keys that may not read at all, so these keys count as good once they have read an object.
        """
        is_missing = isinstance(error, FileNotFoundError)
        if is_missing and self._exists:
            return None
        if not is_missing and not OF_ONE_OBJECT.fullmatch(_code(error)):
            return error
        refusal = self._refusal()
        if refusal and _code(refusal) != DENIED:
            return refusal if is_missing else error
        self._exists = True
        return error if refusal and not is_missing and not self._is_readable else None

    def _refusal(self) -> OSError | None:
        """Return the error of listing, or None."""
        from pyarrow.fs import FileSelector

        try:
            _filesystem(self._name).get_file_info(FileSelector(f"{self._name}/{ABSENT}"))
        except FileNotFoundError:  # as expected
            return None
        except OSError as error:
            return error
        return None


@lru_cache(8)
def _known(bucket: str) -> _Bucket:
    return _Bucket(bucket)


@lru_cache(8)
def _filesystem(bucket: str) -> Any:  # noqa: ANN401 - pyarrow has no types
    """Return the file system of a bucket, in its region. Raises OSError."""
    from pyarrow.fs import FileSystem

    return FileSystem.from_uri(SCHEME + bucket)[0]


def _path(url: str) -> str:
    """Return BUCKET/KEY of a URL. Raises InvalidParameter."""
    path = url[len(SCHEME) :]
    if not _bucket(path):
        raise InvalidParameter(f"{url} lacks the bucket's name: write {SCHEME}BUCKET/FOLDER")
    if not BUCKET_NAME.fullmatch(_bucket(path)):
        raise InvalidParameter(
            f"{masked(url)}: a bucket's name has only the letters A to Z, digits, '.', '_' and '-': write "
            f"{SCHEME}BUCKET/FOLDER; keys are set by AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"
        )
    if "//" in path.rstrip("/"):
        raise InvalidParameter(f"{url}: keys with an empty part (//) cannot be read: rename these objects")
    return path


def _bucket(path: str) -> str:
    return path.partition("/")[0]


def _code(error: OSError) -> str:
    match = AWS_ERROR.search(str(error))
    return match["code"] if match else ""


def _reason(error: OSError) -> str:
    """Return the server's reason without pyarrow's frame."""
    match = AWS_ERROR.search(str(error))
    return f"{match['text'].strip().rstrip('.') or 'no reason'} ({match['code']})" if match else str(error)

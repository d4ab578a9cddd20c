"""API keys: who may call, and what.

A key is a random token of 256 bits; the file keeps its SHA-256, which says nothing about it. Slow hashes are for
what people make up: nobody tries 2^256 tokens, so that a fast one is as safe, and cheap at each request.

The file has a line a key, `NAME SCOPES SHA256`, as `hof key` prints it, SCOPES separated by commas; lines that begin
with # are comments. It is read once, at start.
"""

import hashlib
import hmac
import re
import secrets
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, get_args

from service.errors import InvalidKeys

Scope = Literal["read", "write", "metrics"]

SCOPES: Final[tuple[Scope, ...]] = get_args(Scope)
PREFIX: Final = "hof_"  # by which scanners of leaked secrets know them
NAME: Final = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass(frozen=True)
class Key:
    """What the file keeps of a key.

    name : shown in the log.
    sha256 : of the key, hexadecimal.
    """

    name: str
    scopes: frozenset[str]
    sha256: str

    @property
    def line(self) -> str:
        """Its line of the file."""
        return f"{self.name} {','.join(scope for scope in SCOPES if scope in self.scopes)} {self.sha256}"


class Keys:
    """The keys of a file."""

    def __init__(self, keys: list[Key]) -> None:
        self._keys = keys

    @classmethod
    def read(cls, path: Path) -> "Keys":
        """The keys of a file.

        Raises
        ------
        InvalidKeys : it is missing, malformed or empty, or anyone may write to it.
        """
        try:
            text = path.read_text("utf-8")
            if path.stat().st_mode & stat.S_IWOTH:
                raise InvalidKeys(f"anyone may write to the keys file {path}, and so make keys: `chmod o-w {path}`")
        except OSError as error:
            raise InvalidKeys(f"cannot read the keys file {path}: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise InvalidKeys(f"the keys file {path} is no text") from error
        keys = list(_parse(path, text))
        names = [key.name for key in keys]
        if len(set(names)) < len(names):
            raise InvalidKeys(f"the keys file {path} names two keys alike")
        if not keys:
            raise InvalidKeys(f"the keys file {path} has no key; `hof key NAME --scope read` makes one")
        return cls(keys)

    def __len__(self) -> int:
        return len(self._keys)

    def find(self, token: bytes) -> Key | None:
        """The key that a client shows. Takes as long whichever it is, and whether it is any."""
        digest = hashlib.sha256(token).hexdigest()
        found = None
        for key in self._keys:
            if hmac.compare_digest(key.sha256, digest):
                found = key
        return found


def make_key(name: str, scopes: frozenset[str]) -> tuple[str, Key]:
    """A new key: the token, which is kept nowhere, and what the file keeps. Raises InvalidKeys for a faulty name."""
    if not NAME.fullmatch(name):
        raise InvalidKeys(f"a key's name has 1 to 64 letters, digits, dots, dashes or underscores, not {name!r}")
    token = PREFIX + secrets.token_urlsafe(32)
    return token, Key(name, scopes, hashlib.sha256(token.encode()).hexdigest())


def _parse(path: Path, text: str) -> Iterator[Key]:
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        match line.split():
            case [name, scopes, sha256] if (
                NAME.fullmatch(name) and set(scopes.split(",")) <= set(SCOPES) and re.fullmatch("[0-9a-f]{64}", sha256)
            ):
                yield Key(name, frozenset(scopes.split(",")), sha256)
            case _:  # not quoted: it may hold a key that was pasted there
                raise InvalidKeys(
                    f"line {number} of the keys file {path} is malformed: NAME SCOPES SHA256 is expected, of the "
                    f"scopes {', '.join(SCOPES)}"
                )

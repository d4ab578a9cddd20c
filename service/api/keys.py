"""API keys: clients and their scopes.

A key is a random token of 256 bits, and the keys file stores only its SHA-256. A slow hash would add nothing: it
protects guessable passwords, and nobody can try 2^256 tokens. A fast hash keeps each request cheap.

The file has one line for each key, `NAME SCOPES SHA256`, as `hof key` prints it, with SCOPES separated by commas.
Lines that begin with # are comments. The file is read once, at start.
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
PREFIX: Final = "hof_"  # lets scanners for leaked secrets recognize a key
NAME: Final = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass(frozen=True)
class Key:
    """An entry of the keys file.

    name : shown in the log.
    sha256 : digest of the token, hexadecimal.
    """

    name: str
    scopes: frozenset[str]
    sha256: str

    @property
    def line(self) -> str:
        """The line of the keys file."""
        return f"{self.name} {','.join(scope for scope in SCOPES if scope in self.scopes)} {self.sha256}"


class Keys:
    """The keys of a keys file."""

    def __init__(self, keys: list[Key]) -> None:
        self._keys = keys

    @classmethod
    def read(cls, path: Path) -> "Keys":
        """Read a keys file.

        Raises
        ------
        InvalidKeys : the file is missing, malformed or empty, or anyone may write to it.
        """
        try:
            text = path.read_text("utf-8")
            if path.stat().st_mode & stat.S_IWOTH:
                raise InvalidKeys(f"anyone may write to the keys file {path} and add keys: run `chmod o-w {path}`")
        except OSError as error:
            raise InvalidKeys(f"cannot read the keys file {path}: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise InvalidKeys(f"the keys file {path} is no text: UTF-8 is expected") from error
        keys = list(_parse(path, text))
        names = [key.name for key in keys]
        if len(set(names)) < len(names):
            raise InvalidKeys(f"the keys file {path} names two keys alike: each name may appear once")
        if not keys:
            raise InvalidKeys(f"the keys file {path} has no key: make one with `hof key NAME --scope read`")
        return cls(keys)

    def __len__(self) -> int:
        return len(self._keys)

    def find(self, token: bytes) -> Key | None:
        """Return the key of a token; None for an unknown token. Takes the same time for every token."""
        digest = hashlib.sha256(token).hexdigest()
        match = None
        for key in self._keys:
            if hmac.compare_digest(key.sha256, digest):
                match = key
        return match


def make_key(name: str, scopes: frozenset[str]) -> tuple[str, Key]:
    """Make a key: the token, which is stored nowhere, and its entry for the file. Raises InvalidKeys for a bad name."""
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
            case _:  # the line is not shown: a token may have been pasted there
                raise InvalidKeys(
                    f"line {number} of the keys file {path} is malformed: NAME SCOPES SHA256 is expected, with scopes "
                    f"from {', '.join(SCOPES)}"
                )

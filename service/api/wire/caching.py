"""HTTP caching and compression.

Objects never change, because their ids are digests: the same request always has the same answer.
"""

import hashlib
import re
from typing import Final

from service import __version__

CACHE_CONTROL: Final = "max-age=31536000, immutable"  # not `public`: shared caches must not keep answers to keys
_TAG: Final = re.compile(r'(?:W/)?("[^"]*")')


def etag(*parts: object) -> str:
    """Return a weak ETag (RFC 9110, section 8.8.3) of an answer's id and parameters, and of this version.

    Weak, because outputs agree between machines only to rounding.
    """
    text = repr((__version__, *parts))
    return f'W/"{hashlib.sha256(text.encode()).hexdigest()[:32]}"'


def is_fresh(if_none_match: str | None, tag: str) -> bool:
    """Return whether an If-None-Match header (section 13.1.2) names the tag, by weak comparison."""
    if if_none_match is None:
        return False
    if if_none_match.strip() == "*":
        return True
    return tag.removeprefix("W/") in _TAG.findall(if_none_match)


def accepts_gzip(accept_encoding: str | None) -> bool:
    """Return whether an Accept-Encoding header (section 12.5.3) allows gzip by name."""
    for part in (accept_encoding or "").lower().split(","):
        coding, *parameters = (field.strip() for field in part.split(";"))
        if coding in ("gzip", "x-gzip"):
            return not any(re.fullmatch(r"q\s*=\s*0(\.0*)?", parameter) for parameter in parameters)
    return False

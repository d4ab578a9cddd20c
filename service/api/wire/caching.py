"""HTTP caching and compression of what never changes: an id is a digest, the same question has the same answer."""

import hashlib
import re
from typing import Final

from service import __version__

CACHE_CONTROL: Final = "max-age=31536000, immutable"  # not `public`: with a key, caches that are shared must not
_TAG: Final = re.compile(r'(?:W/)?("[^"]*")')


def etag(*parts: object) -> str:
    """A weak ETag (RFC 9110, section 8.8.3) of an answer's id and parameters, and of this version.

    Weak, since outputs agree between machines to rounding only.
    """
    text = repr((__version__, *parts))
    return f'W/"{hashlib.sha256(text.encode()).hexdigest()[:32]}"'


def is_fresh(if_none_match: str | None, tag: str) -> bool:
    """Whether an If-None-Match header (section 13.1.2) names the tag, by weak comparison."""
    if if_none_match is None:
        return False
    if if_none_match.strip() == "*":
        return True
    return tag.removeprefix("W/") in _TAG.findall(if_none_match)


def accepts_gzip(accept_encoding: str | None) -> bool:
    """Whether an Accept-Encoding header (section 12.5.3) allows gzip by name."""
    for part in (accept_encoding or "").lower().split(","):
        coding, *parameters = (field.strip() for field in part.split(";"))
        if coding in ("gzip", "x-gzip"):
            return not any(re.fullmatch(r"q\s*=\s*0(\.0*)?", parameter) for parameter in parameters)
    return False

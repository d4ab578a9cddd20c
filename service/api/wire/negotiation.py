"""Content negotiation: choose a file format by the Accept header (RFC 9110, section 12.5.1)."""

from collections.abc import Collection
from typing import Protocol, TypeVar

from service.errors import NotAcceptable


class HasMediaType(Protocol):
    """A file format that names its media type."""

    @property
    def media_type(self) -> str:
        """The media type, as in Content-Type."""


Format = TypeVar("Format", bound=HasMediaType)


def negotiate(accept: str | None, formats: Collection[Format]) -> Format:
    """Return the format that an Accept header prefers; the first format if it has no preference.

    The highest q wins; then the more exact range, then the range named first.

    Raises
    ------
    NotAcceptable : the header allows none of the formats.
    """
    ranges = _media_ranges(accept or "*/*")
    ranked = [
        (q, exactness, earliness, fmt)
        for fmt in formats
        for exactness, q, earliness in [_best_range(fmt.media_type, ranges)]
        if q > 0
    ]
    if not ranked:
        offered = ", ".join(dict.fromkeys(fmt.media_type for fmt in formats))
        raise NotAcceptable(f"the Accept header allows none of {offered}", field="Accept")
    return max(ranked, key=lambda candidate: candidate[:3])[3]  # max keeps the first of equals


def _media_ranges(accept: str) -> list[tuple[str, float]]:
    """Return (range, q) pairs in the header's order; malformed ranges are skipped."""
    ranges = []
    for part in accept.lower().split(","):
        media_range, *parameters = (field.strip() for field in part.split(";"))
        quality = next((value[2:] for value in parameters if value.startswith("q=")), "1")
        try:
            q = float(quality)
        except ValueError:
            continue
        if "/" in media_range and 0 <= q <= 1:
            ranges.append((media_range, q))
    return ranges


def _best_range(media_type: str, ranges: list[tuple[str, float]]) -> tuple[int, float, int]:
    """Return the most exact range that covers a media type, as (exactness, q, earliness); q is 0 without a match."""
    covers = (media_type, media_type.split("/")[0] + "/*", "*/*")
    return max(
        (
            (len(covers) - covers.index(media_range), q, -position)
            for position, (media_range, q) in enumerate(ranges)
            if media_range in covers
        ),
        default=(0, 0.0, 0),
    )

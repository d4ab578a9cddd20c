"""The command `hof` for which no JPEG ever ends: `python -m tests.support.systems.endless_jpeg serve ...`.

The decoder gets the first marker of the file and then zeros, which it skips until the next marker. Each of its reads
reads the file as well, so whatever stops reading stops the decoding, and nothing else does.
"""

import sys
from typing import Final

from PIL.JpegImagePlugin import JpegImageFile

from service.cli import main

COMMAND: Final = (sys.executable, "-m", "tests.support.systems.endless_jpeg")
BEGUN: Final = "the decoding of a JPEG begins"  # on stderr
MARKER_BYTES: Final = 2


def _read_endlessly(file: JpegImageFile, size: int) -> bytes:
    """Return the next bytes for the decoder, as Pillow's `load_read` does."""
    assert file.fp is not None
    is_first = file.fp.tell() == 0
    data: bytes = file.fp.read(size)
    if not is_first:
        return bytes(size)
    print(BEGUN, file=sys.stderr, flush=True)
    return data[:MARKER_BYTES]


if __name__ == "__main__":
    JpegImageFile.load_read = _read_endlessly  # type: ignore[assignment, method-assign]
    sys.exit(main())

"""A line on the terminal that counts what is done, with speed and time left."""

import sys
import time
from typing import Final

REFRESH_S: Final = 0.2


class ProgressLine:
    """A line on stderr, rewritten in place; nothing if stderr is not a terminal.

    Parameters
    ----------
    unit : what is counted, in the plural.
    """

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._is_shown = sys.stderr.isatty()
        self._began: tuple[float, int] | None = None
        self._drawn_at = 0.0

    def __call__(self, done: int, total: int) -> None:
        """Show the numbers; at most every `REFRESH_S` seconds, and at the end."""
        now = time.monotonic()
        began_at, at_first = self._began = self._began or (now, done)  # what an earlier run did tells no speed
        if not self._is_shown or (now - self._drawn_at < REFRESH_S and done < total):
            return
        self._drawn_at = now
        print(f"\r\x1b[K{line(done, total, done - at_first, now - began_at, self._unit)}", end="", file=sys.stderr)

    def end(self) -> None:
        """Leave the line, so that other text starts on a new one."""
        if self._is_shown and self._began:
            print(file=sys.stderr)


def line(done: int, total: int, newly: int, elapsed_s: float, unit: str) -> str:
    """Return the line's text: `newly` of those done took `elapsed_s`."""
    text = f"{done:,} of {total:,} {unit}"
    if not newly or not elapsed_s:
        return text
    rate = newly / elapsed_s
    minutes, seconds = divmod(round((total - done) / rate), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{text}, {rate:.1f} {unit}/s, {hours}:{minutes:02}:{seconds:02} left"

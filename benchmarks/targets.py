"""Measured figures beside their targets."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """A measured figure and its limit."""

    what: str
    measured: float
    limit: float
    at_most: bool = False

    @property
    def met(self) -> bool:
        """Return whether the measured figure is on the right side of the limit."""
        return self.measured <= self.limit if self.at_most else self.measured >= self.limit


def targets_table(targets: Sequence[Target]) -> str:
    """Return a Markdown table of measured figures and their limits."""
    rows = [
        f"| {item.what} | {item.measured:.2f} | {'<=' if item.at_most else '>='} {item.limit:g} | "
        f"{'yes' if item.met else '**no**'} |"
        for item in targets
    ]
    return "\n".join(["| figure | measured | target | met |", "|---|---|---|---|", *rows])

"""Transactions on a pool of connections, the interface of both databases."""

from collections.abc import Callable
from typing import Protocol, TypeVar

from sqlalchemy import Connection

R = TypeVar("R")
Work = Callable[[Connection], R]


class Database(Protocol):
    """Transactions on a pool of connections.

    Attributes
    ----------
    max_silence_s : time without any answer after which the database counts as unreachable.
    """

    dialect: str
    max_silence_s: float

    async def run(self, work: Work[R], *, timeout_s: float | None = None) -> R:
        """Call a function with a connection, in a transaction: on disk when this returns, undone if it raises.

        Parameters
        ----------
        timeout_s : longest time, instead of the database's own; SQLite ignores it.

        Raises
        ------
        Overloaded, StoreUnavailable : no connection was free in time, or no answer came.
        """

    async def look_up(self, work: Work[R]) -> R:
        """Call a function that reads a few rows by their keys, and nothing else. Raises as `run` does."""

    async def write(self, work: Work[R]) -> R:
        """Call a function as `run` does, in a transaction that it may share with other calls of this method.

        It may be called twice: again if another call undoes the first. Its own error undoes it alone.
        """

    def ping(self, connection: Connection) -> None:
        """Do the least work that shows that the database can be used. Raises StoreUnavailable or a driver's error."""

    async def close(self) -> None:
        """Close all connections."""

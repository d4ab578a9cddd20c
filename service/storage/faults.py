"""Faults of a database: from the driver's errors to those of this project."""

import sqlite3
from collections.abc import Sequence
from typing import Final

from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.errors import HofError, Overloaded, StoreFull, StoreUnavailable, UnreachableStore, UnusableStore

RETRY_AFTER_S: Final = 5

# What to do, by SQLite's primary result code.
REMEDIES: Final = {
    sqlite3.SQLITE_NOTADB: "name another file, or restore a backup",
    sqlite3.SQLITE_CORRUPT: "restore a backup, or rescue what can be read with `sqlite3 OLD .recover | sqlite3 NEW`",
    sqlite3.SQLITE_READONLY: "it cannot be written: hof must be able to write the file and its folder",
    sqlite3.SQLITE_CANTOPEN: "name a file in a folder that hof can write",
    sqlite3.SQLITE_FULL: "free some space",
}
# SQLite reports an exceeded quota as an input/output error.
FULL_SQLITE: Final = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE, sqlite3.SQLITE_IOERR_SHMSIZE}
BROKEN_SQLITE: Final = {
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_CORRUPT,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_NOTADB,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_READONLY,
}

# PostgreSQL's error codes (SQLSTATE, appendix A of its manual); two characters stand for a class.
FULL: Final = "53100"  # disk_full
READ_ONLY: Final = "25006"  # read_only_sql_transaction: a standby, or default_transaction_read_only
TEMPORARY: Final = (
    "08",  # connection exception
    "25",  # invalid transaction state: read-only, or a time-out
    "40",  # transaction rollback: deadlock, serialization failure
    "53",  # insufficient resources: no connection, no memory
    "55",  # object not in prerequisite state: lock_timeout
    "57",  # operator intervention: shutdown, start, statement_timeout
    "58",  # system error: input or output
)
REFUSED: Final = ("28", "3D")  # a changed password; a dropped database
MIN_SECRET: Final = 3  # hiding shorter ones would only garble a message


def no_answer(timeout_s: float) -> StoreUnavailable:
    """Return the error for a database that gave no answer in time."""
    return StoreUnavailable(
        f"the database did not answer within {timeout_s:g} s; try again later", retry_after_s=RETRY_AFTER_S
    )


def read_only() -> StoreUnavailable:
    """Return the error for a database that accepts no writes."""
    return StoreUnavailable("the database accepts no writes at present; try again later", retry_after_s=RETRY_AFTER_S)


def too_busy() -> Overloaded:
    """Return the error for a database that works, but not for this call."""
    return Overloaded("other calls held the database for too long; try again later")


def domain_error(error: Exception) -> Exception:
    """Return the error of this project for a driver's error; the same error if only a fault of ours explains it."""
    if isinstance(error, HofError):
        return error
    if isinstance(error, PoolTimeout) or is_locked(_cause(error)):
        return too_busy()
    if is_full(error):
        return StoreFull("the database has no space left; nothing of this call is kept")
    if _sqlstate(error) == READ_ONLY:
        return read_only()
    if is_temporary(error) or _sqlstate(error).startswith(REFUSED) or _sqlite_code(error) & 0xFF in BROKEN_SQLITE:
        return StoreUnavailable("the database cannot be used at present; try again later", retry_after_s=RETRY_AFTER_S)
    return error


def is_temporary(error: Exception) -> bool:
    """Return whether the same call may succeed later, without a change of the settings."""
    if isinstance(error, Overloaded | StoreUnavailable | PoolTimeout) or is_locked(_cause(error)):
        return True
    if isinstance(error, OSError):  # no connection; TimeoutError is one, too
        return True
    if not isinstance(error, DBAPIError) or is_full(error):
        return False
    state = _sqlstate(error)
    if state:
        return state.startswith(TEMPORARY)
    # The driver's own errors have no code: a connection that broke, no host that accepts writes.
    return error.connection_invalidated or any(word in str(error.orig) for word in ("connection", "None of the hosts"))


def is_locked(error: BaseException | None) -> bool:
    """Return whether another connection holds SQLite's lock."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY


def is_full(error: Exception) -> bool:
    """Return whether a write failed because no space is left."""
    return _sqlite_code(error) in FULL_SQLITE or _sqlstate(error) == FULL


def is_read_only(error: Exception) -> bool:
    """Return whether PostgreSQL refused a write because it accepts none."""
    return _sqlstate(error) == READ_ONLY


def reason_of(error: BaseException) -> str:
    """Return the first line of a driver's message."""
    cause = _cause(error)
    if isinstance(cause, TimeoutError):
        return "it did not answer in time"
    return next(iter(str(cause).splitlines()), "") or type(cause).__name__


def unusable(shown: str, secrets: Sequence[str], error: Exception) -> UnusableStore:
    """Return the error that refuses a start: the driver's reason in one line, without secrets, and a remedy.

    Parameters
    ----------
    shown : the database's URL, without its password.
    """
    reason = reason_of(error)
    for secret in secrets:
        if len(secret) >= MIN_SECRET:
            reason = reason.replace(secret, "***")
    bad_file = shown.startswith("sqlite") and isinstance(error, OSError)
    remedy = REMEDIES.get(sqlite3.SQLITE_CANTOPEN if bad_file else _sqlite_code(error) & 0xFF)
    message = f"cannot open the database {shown}: {reason}" + (f"; {remedy}" if remedy else "")
    return (UnreachableStore if is_temporary(error) and not bad_file else UnusableStore)(message)


def _cause(error: BaseException) -> BaseException:
    return getattr(error, "orig", None) or error


def _sqlstate(error: Exception) -> str:
    return getattr(_cause(error), "sqlstate", None) or ""


def _sqlite_code(error: Exception) -> int:
    return getattr(_cause(error), "sqlite_errorcode", None) or 0

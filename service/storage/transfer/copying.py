"""Copy all objects of one store into another one, of the same or the other kind of database."""

from collections.abc import AsyncIterator, Callable, Sequence

from service.storage.rows import Entry
from service.storage.store import Store
from service.storage.transfer.content import Tally, put_checked

Progress = Callable[[int, int], None]  # objects done, and all


async def copy(source: Store, target: Store, progress: Progress) -> Tally:
    """Copy the objects that exist in `source` at the start. One that `target` has stays there as it is.

    A copy that broke off is continued by calling this again: what arrived is compared, not written again.
    """
    tally, count = Tally(), await source.count()
    async for entries in batches(source, await source.last_seq()):
        await put_checked(target, entries, tally)
        progress(tally.total, count)
    return tally


async def batches(source: Store, last: int) -> AsyncIterator[Sequence[Entry]]:
    """Yield the objects up to the one that is the last now, oldest first, so a word comes after its objects.

    The objects of a word are older than the word, and cannot be deleted before it. So they are in a batch before its.
    """
    after = 0
    while entries := await source.entries(after, last):
        after = entries[-1].seq
        yield entries

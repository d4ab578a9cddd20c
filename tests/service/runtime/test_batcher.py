"""Images that share a call: none waits for ever, none pays for another."""

import asyncio
import random
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from service.encoding.encoder import Encoded, Encoder
from service.mapping.spec import Array
from service.runtime.batcher import MAX_BATCH, Batcher
from service.settings import SHIPPED_MODEL

SCHEDULES = 1_000
TIMEOUT_S = 60


def _image(value: float) -> Array:
    return np.full((1, 3, 2, 2), value, np.float32)


def _encode(images: Array) -> list[Encoded]:
    """Return the image's mean, twice, as theta; a negative image fails whatever call it is in."""
    if (images < 0).any():
        raise ValueError("negative")
    return [Encoded(np.repeat(mean, 2)) for mean in images.mean(axis=(1, 2, 3))]


def _batcher(executor: ThreadPoolExecutor, threads: int = 1) -> Batcher:
    return Batcher(_encode, lambda function: asyncio.get_running_loop().run_in_executor(executor, function), threads)


async def _schedule(batcher: Batcher, seed: int) -> None:
    """Send images at random moments, some that fail and some whose client leaves; each must get its own result."""
    dice = random.Random(seed)

    async def one(index: int) -> None:
        for _ in range(dice.randrange(4)):
            await asyncio.sleep(0)
        fails, leaves = dice.random() < 0.2, dice.random() < 0.3
        value = -1.0 if fails else float(index)
        task = asyncio.create_task(batcher.encode(_image(value)))
        if leaves:
            for _ in range(dice.randrange(4)):
                await asyncio.sleep(0)
            task.cancel()
        (outcome,) = await asyncio.gather(task, return_exceptions=True)
        if isinstance(outcome, asyncio.CancelledError):
            assert leaves
        elif isinstance(outcome, BaseException):
            assert fails, outcome
            assert isinstance(outcome, ValueError)
        else:
            assert not fails
            np.testing.assert_array_equal(outcome.theta, [index, index])

    await asyncio.gather(*(one(index) for index in range(dice.randrange(1, 3 * MAX_BATCH))))


def test_batcher_under_any_schedule_answers_every_image_with_its_own() -> None:
    async def all_schedules(executor: ThreadPoolExecutor) -> int:
        batcher = _batcher(executor)
        for seed in range(SCHEDULES):
            async with asyncio.timeout(TIMEOUT_S):
                await _schedule(batcher, seed)
        return batcher.images

    with ThreadPoolExecutor(2) as executor:
        assert asyncio.run(all_schedules(executor)) > SCHEDULES


def test_batcher_with_waiting_images_shares_a_call_without_those_that_left() -> None:
    async def scenario(executor: ThreadPoolExecutor) -> tuple[int, int]:
        batcher = _batcher(executor)
        busy = threading.Event()
        held = asyncio.get_running_loop().run_in_executor(executor, busy.wait, TIMEOUT_S)
        tasks = [asyncio.create_task(batcher.encode(_image(index))) for index in range(MAX_BATCH + 3)]
        await asyncio.sleep(0)
        for task in tasks[:3]:
            task.cancel()
        busy.set()
        await asyncio.gather(held, *tasks, return_exceptions=True)
        return batcher.images, batcher.calls

    with ThreadPoolExecutor(1) as executor:
        assert asyncio.run(scenario(executor)) == (MAX_BATCH, 1)


def test_batcher_with_photos_that_have_arrived_lets_them_share_the_call() -> None:
    async def scenario(executor: ThreadPoolExecutor) -> tuple[int, int]:
        batcher, loop = _batcher(executor), asyncio.get_running_loop()

        async def photo(index: int) -> Encoded:
            with batcher.coming():
                await loop.run_in_executor(executor, time.sleep, 0.001)
            return await batcher.encode(_image(index))

        await asyncio.gather(*(photo(index) for index in range(MAX_BATCH)))
        return batcher.images, batcher.calls

    with ThreadPoolExecutor(1) as executor:
        assert asyncio.run(scenario(executor)) == (MAX_BATCH, 1)


def test_batcher_with_a_photo_that_never_comes_goes_on_without_it() -> None:
    async def scenario(executor: ThreadPoolExecutor) -> None:
        batcher = _batcher(executor)
        with batcher.coming():
            async with asyncio.timeout(TIMEOUT_S):
                np.testing.assert_array_equal((await batcher.encode(_image(3))).theta, [3, 3])

    with ThreadPoolExecutor(1) as executor:
        asyncio.run(scenario(executor))


def test_encode_then_of_photos_with_several_images_keeps_each_photo_in_one_call() -> None:
    def values(encoded: list[Encoded]) -> list[float]:
        return [float(each.theta[0]) for each in encoded]

    async def scenario(executor: ThreadPoolExecutor, counts: list[int]) -> tuple[list[object], int, int]:
        batcher = _batcher(executor)
        photos = [np.concatenate([_image(10 * number + look) for look in range(n)]) for number, n in enumerate(counts)]
        answers = await asyncio.gather(*(batcher.encode_then(photo, values) for photo in photos))
        return list(answers), batcher.images, batcher.calls

    for counts, calls in (([2] * 5, 2), ([1, 2] * 2, 1), ([7, 2], 2), ([MAX_BATCH + 1, 1], 2)):
        with ThreadPoolExecutor(1) as executor:
            answers, images, total = asyncio.run(scenario(executor, counts))
        assert answers == [[10 * number + look for look in range(n)] for number, n in enumerate(counts)]
        assert (images, total) == (sum(counts), calls)


def test_batcher_that_counts_while_photos_arrive_answers_all() -> None:
    class Photo(np.ndarray[tuple[int, ...], np.dtype[np.float32]]):
        """Images; when they are first counted, another photo arrives."""

        arrive: Callable[[], None] = staticmethod(lambda: None)

        def __len__(self) -> int:
            self.arrive()
            self.arrive = lambda: None
            return super().__len__()

    async def scenario(executor: ThreadPoolExecutor) -> list[Encoded]:
        loop, batcher, arrived, later = asyncio.get_running_loop(), _batcher(executor), threading.Event(), []

        def add() -> None:
            later.append(asyncio.create_task(batcher.encode(_image(2))))
            loop.call_soon(arrived.set)  # after the task has added its image

        def arrive() -> None:
            loop.call_soon_threadsafe(add)
            assert arrived.wait(TIMEOUT_S)

        photo = _image(1).view(Photo)
        photo.arrive = arrive
        with batcher.coming():
            first = await batcher.encode(photo)
        return [first, *await asyncio.gather(*later)]

    with ThreadPoolExecutor(1) as executor:
        assert [float(each.theta[0]) for each in asyncio.run(scenario(executor))] == [1, 2]


def test_encode_then_runs_on_the_worker_and_its_error_is_that_of_its_image_alone() -> None:
    def invert(encoded: list[Encoded]) -> tuple[float, str]:
        if not encoded[0].theta[0]:
            raise ZeroDivisionError
        return 1 / float(encoded[0].theta[0]), threading.current_thread().name

    async def scenario(executor: ThreadPoolExecutor) -> tuple[list[object], int]:
        batcher = _batcher(executor)
        tasks = [batcher.encode_then(_image(value), invert) for value in (2, 0, 4)]
        return await asyncio.gather(*tasks, return_exceptions=True), batcher.calls

    with ThreadPoolExecutor(1, thread_name_prefix="worker") as executor:
        (first, error, last), calls = asyncio.run(scenario(executor))
    assert (first, last, calls) == ((0.5, "worker_0"), (0.25, "worker_0"), 1)
    assert isinstance(error, ZeroDivisionError)


def test_encode_then_of_one_call_runs_on_all_threads_at_once() -> None:
    together = threading.Barrier(3)

    async def scenario(executor: ThreadPoolExecutor) -> list[int]:
        batcher = _batcher(executor, threads=3)
        tasks = [batcher.encode_then(_image(value), lambda _: together.wait(TIMEOUT_S)) for value in range(3)]
        return await asyncio.gather(*tasks)

    with ThreadPoolExecutor(3) as executor:
        assert sorted(asyncio.run(scenario(executor))) == [0, 1, 2]


@pytest.mark.parametrize("threads", [1, 2])
def test_encode_then_of_a_client_that_left_computes_nothing(threads: int) -> None:
    encoding, left, finished = threading.Event(), threading.Event(), []

    def encode(images: Array) -> list[Encoded]:
        encoding.set()
        left.wait(TIMEOUT_S)
        return _encode(images)

    async def scenario(executor: ThreadPoolExecutor) -> None:
        loop = asyncio.get_running_loop()
        batcher = Batcher(encode, lambda function: loop.run_in_executor(executor, function), threads)
        stays, leaves = (
            asyncio.create_task(
                batcher.encode_then(_image(value), lambda encoded: finished.append(encoded[0].theta[0]))
            )
            for value in (1, 2)
        )
        await asyncio.to_thread(encoding.wait, TIMEOUT_S)
        leaves.cancel()
        await asyncio.sleep(0)
        left.set()
        await stays

    with ThreadPoolExecutor(threads) as executor:
        asyncio.run(scenario(executor))
    assert finished == [1]


def test_batcher_with_a_closed_executor_fails_its_images() -> None:
    async def scenario() -> None:
        executor = ThreadPoolExecutor(1)
        executor.shutdown()
        batcher = _batcher(executor)
        async with asyncio.timeout(TIMEOUT_S):
            for _ in range(2):
                with pytest.raises(RuntimeError, match="shutdown"):
                    await batcher.encode(_image(0))

    asyncio.run(scenario())


def test_batcher_in_any_batch_gives_the_same_theta() -> None:
    encoder = Encoder.open(SHIPPED_MODEL, 1)
    size = encoder.framing.size
    images = np.random.default_rng(0).random((MAX_BATCH, 3, size, size), np.float32)
    alone = [encoder.encode(image[None])[0].theta for image in images]
    for count in (2, 3, MAX_BATCH):
        together = [functions.theta for functions in encoder.encode(images[:count])]
        np.testing.assert_allclose(together, alone[:count], atol=1e-5)

"""Methods of the two clients, made from the functions that build calls.

The types carry over: a method takes the parameters of the function, and returns what the call reads.
"""

import inspect
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from hof_client.request import Call, SizedT, Stream

P = ParamSpec("P")
T = TypeVar("T")
Build = Callable[..., Any]


class Sender(Protocol):
    """A client that blocks."""

    def send(self, call: Call[T]) -> T:
        """Send a call and return its answer."""

    def iterate(self, stream: Stream[SizedT]) -> Iterator[SizedT]:
        """Send a call and iterate over its answer."""


class AsyncSender(Protocol):
    """A client that awaits."""

    async def send(self, call: Call[T]) -> T:
        """Send a call and return its answer."""

    def iterate(self, stream: Stream[SizedT]) -> AsyncGenerator[SizedT, None]:
        """Send a call and iterate over its answer."""


def sending(build: Callable[P, Call[T]]) -> Callable[Concatenate[Sender, P], T]:
    """Return the method that sends the call which `build` builds, and returns the answer."""

    def method(client: Sender, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return client.send(build(*args, **kwargs))

    return _describe(method, build)


def iterating(build: Callable[P, Stream[SizedT]]) -> Callable[Concatenate[Sender, P], Iterator[SizedT]]:
    """Return the method that sends the call, and iterates over the answer."""

    def method(client: Sender, /, *args: P.args, **kwargs: P.kwargs) -> Iterator[SizedT]:
        return client.iterate(build(*args, **kwargs))

    return _describe(method, build)


def awaiting(build: Callable[P, Call[T]]) -> Callable[Concatenate[AsyncSender, P], Awaitable[T]]:
    """Return the method that sends the call and returns the answer, to be awaited."""

    async def method(client: AsyncSender, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await client.send(build(*args, **kwargs))

    return _describe(method, build)


def async_iterating(
    build: Callable[P, Stream[SizedT]],
) -> Callable[Concatenate[AsyncSender, P], AsyncGenerator[SizedT, None]]:
    """Return the method that sends the call, and iterates over the answer with `async for`."""

    def method(client: AsyncSender, /, *args: P.args, **kwargs: P.kwargs) -> AsyncGenerator[SizedT, None]:
        return client.iterate(build(*args, **kwargs))

    return _describe(method, build)


MethodT = TypeVar("MethodT", bound=Build)


def _describe(method: MethodT, build: Build) -> MethodT:
    """Give a method the name, the documentation, the signature and, as `__wrapped__`, the function it sends for."""
    signature = inspect.signature(build)
    self = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    (answer,) = getattr(signature.return_annotation, "__args__", (Any,))
    parameters = [self, *signature.parameters.values()]
    vars(method).update(
        __wrapped__=build, __signature__=signature.replace(parameters=parameters, return_annotation=answer)
    )
    method.__name__, method.__doc__ = build.__name__.rstrip("_"), build.__doc__
    method.__qualname__, method.__module__ = method.__name__, build.__module__
    return method

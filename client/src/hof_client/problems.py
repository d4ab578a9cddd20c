"""The errors of this package. Those under `Problem` are the service's answers, by name and status.

    HofError
    ├── ConnectionFailed             the connection broke before the answer began
    │   ├── Unreachable              no connection: refused, no such host, not in time
    │   ├── TimedOut                 connected, but nothing came in time
    │   └── Truncated                the answer broke off before its end
    ├── UnexpectedAnswer             an answer that is not the documented one: another service, another version
    └── Problem                      an error that the service answered
        ├── InvalidInput        400  bytes that are not of the claimed type
        │   ├── CorruptImage
        │   ├── CorruptPoints
        │   └── CorruptWeights
        ├── Unauthenticated     401  no API key, or an unknown one
        ├── Forbidden           403  a key without the scope that the call needs
        ├── NotFound            404  no object with this id
        ├── NotAcceptable       406  no format satisfies the Accept header
        ├── Stalled             408  a client that stopped sending
        ├── InUse               409  an object that a composed object uses
        ├── TooLarge            413  more bytes or pixels than the limit
        ├── UnsupportedMedia    415  a body that is not an image of a supported type
        ├── Misdirected         421  a host name that is not the service's
        ├── InvalidParameter    422  a parameter unknown, of the wrong type or out of range
        │   ├── NoObjectFound        no object to encode in the image
        │   └── InvalidSpec          a mapping spec that describes no function
        ├── HeadTooLarge        431  a request's target and header fields, in bytes
        ├── TryLater                 a call that may succeed later: `retry_after_s`
        │   ├── Overloaded      429  the queue or a limit in flight is full
        │   ├── RateLimited     429  more requests than the rate limit
        │   ├── NotReady        503  the service is starting or stopping
        │   └── StoreUnavailable 503 the database does not answer, or accepts no writes
        ├── UnsupportedVersion  505  another version of HTTP than 1.0 and 1.1
        └── StoreFull           507  the database has no space left

A status without a class of its own is a plain `Problem`; 502 and 504, which proxies answer, are a `TryLater`.
"""

from typing import Final

from hof_client.answers import FieldError


class HofError(Exception):
    """Base class of all errors of this package."""


class ConnectionFailed(HofError):
    """The connection broke before the answer began."""


class Unreachable(ConnectionFailed):
    """No connection to the service; nothing was sent."""


class TimedOut(ConnectionFailed):
    """No byte came, or none could be sent, within the client's `timeout_s`."""


class Truncated(ConnectionFailed):
    """The answer broke off before its end."""


class UnexpectedAnswer(HofError):
    """An answer that is not the documented one: of another service, or of a version that does not fit."""


class Problem(HofError):
    """An error that the service answered (RFC 9457).

    Attributes
    ----------
    status : HTTP status.
    type, title : kind of problem, as a URN and in words.
    detail : the fault, and what to do.
    errors : one entry for each faulty parameter.
    request_id : id of the request in the service's log; "" if the answer has none.
    """

    status = 0
    title = ""

    def __init__(
        self,
        detail: str,
        *,
        type: str = "about:blank",  # noqa: A002 - the name in the RFC
        title: str | None = None,
        status: int | None = None,
        errors: tuple[FieldError, ...] = (),
        request_id: str = "",
    ) -> None:
        super().__init__(detail)
        self.type = type
        self.title = self.title if title is None else title
        self.status = self.status if status is None else status
        self.detail = detail
        self.errors = errors
        self.request_id = request_id

    def __str__(self) -> str:
        return f"{self.status} {self.title}: {self.detail}"


class InvalidInput(Problem):
    """Bytes that are not of the claimed type."""

    status = 400
    title = "Invalid input"


class CorruptImage(InvalidInput):
    """An image of a known type whose bytes cannot be decoded."""

    title = "Corrupt image"


class CorruptPoints(InvalidInput):
    """A file of points or of a mesh that cannot be read."""

    title = "Corrupt points"


class CorruptWeights(InvalidInput):
    """A weights file that cannot be read, or whose numbers do not match its spec."""

    title = "Corrupt weights"


class Unauthenticated(Problem):
    """No API key, or an unknown one."""

    status = 401
    title = "Unauthenticated"


class Forbidden(Problem):
    """A key without the scope that the call needs."""

    status = 403
    title = "Forbidden"


class NotFound(Problem):
    """No object with this id, no model of this name, or no such path."""

    status = 404
    title = "Not found"


class NotAcceptable(Problem):
    """No format of the service satisfies the request's Accept header."""

    status = 406
    title = "Not acceptable"


class Stalled(Problem):
    """A request whose next bytes did not arrive in time."""

    status = 408
    title = "Stalled"


class InUse(Problem):
    """An object that cannot be deleted while a composed object uses it."""

    status = 409
    title = "In use"


class TooLarge(Problem):
    """More bytes or pixels than the limit, which `detail` names."""

    status = 413
    title = "Too large"


class UnsupportedMedia(Problem):
    """A body that is not one of the supported image types."""

    status = 415
    title = "Unsupported media type"


class Misdirected(Problem):
    """A request for a host name that this service does not answer for."""

    status = 421
    title = "Misdirected request"


class InvalidParameter(Problem):
    """A parameter that is unknown, of the wrong type or out of range; `errors` names it."""

    status = 422
    title = "Invalid parameter"


class NoObjectFound(InvalidParameter):
    """An image without an object to encode."""

    title = "No object found"


class InvalidSpec(InvalidParameter):
    """A mapping spec that describes no function."""

    title = "Invalid spec"


class HeadTooLarge(Problem):
    """A request whose target and header fields have more bytes than the limit."""

    status = 431
    title = "Head too large"


class TryLater(Problem):
    """A call that may succeed if it is repeated; the client did so as often as its `Retry` allows.

    Attributes
    ----------
    retry_after_s : seconds until a repeat may succeed; None if the answer does not say.
    """

    retry_after_s: float | None = None


class Overloaded(TryLater):
    """More work than the service accepts at a time."""

    status = 429
    title = "Overloaded"


class RateLimited(TryLater):
    """More requests than the rate limit."""

    status = 429
    title = "Rate limited"


class NotReady(TryLater):
    """The service is starting or stopping."""

    status = 503
    title = "Not ready"


class StoreUnavailable(TryLater):
    """The service's database does not answer, accepts no writes, or refuses for another reason that may pass."""

    status = 503
    title = "Store unavailable"


class UnsupportedVersion(Problem):
    """A request of another version of HTTP than 1.0 and 1.1."""

    status = 505
    title = "HTTP version not supported"


class StoreFull(Problem):
    """The database has no space left; nothing of the call is kept."""

    status = 507
    title = "Insufficient storage"


LATER: Final = frozenset({429, 502, 503, 504})  # statuses of answers that a repeat may change

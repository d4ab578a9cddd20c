"""The errors of this project; `service.api.problems` turns each into an answer with its HTTP status.

    HofError                    500
    ├── InvalidInput            400  a body that cannot be read, or a request against the rules of HTTP
    │   ├── CorruptImage
    │   ├── CorruptPoints
    │   └── CorruptWeights
    ├── Unauthenticated         401  no API key, or an unknown one
    ├── Forbidden               403  a key without the scope that the call needs; another site's page
    ├── NotFound                404  no object with this id, or no model or page of this name
    ├── NotAcceptable           406  no format satisfies the Accept header
    ├── Stalled                 408  a request that arrives too slowly
    ├── InUse                   409  an object that a composed object uses
    ├── TooLarge                413  more bytes or pixels than the limit
    ├── UnsupportedMedia        415  a body that is not an image, or points, of a supported type
    ├── Misdirected             421  a host name that is not this service's
    ├── InvalidParameter        422  a parameter unknown, of the wrong type or out of range
    │   ├── NoObjectFound            no object to encode in the image
    │   └── InvalidSpec              a mapping spec that describes no function
    ├── HeadTooLarge            431  a request's target and header fields, in bytes
    ├── TryLater                     a call that may succeed later, and when
    │   ├── Overloaded          429  the queue or a limit in flight is full
    │   ├── RateLimited         429  more requests than the rate limit
    │   ├── NotReady            503  the service starts or stops, or a part of it does not answer
    │   └── StoreUnavailable    503  the database does not answer, or accepts no writes
    ├── UnsupportedVersion      505  another version of HTTP than 1.0 and 1.1
    ├── StoreFull               507  the database has no space left
    ├── InvalidModel            500  the model file is unusable: refused at start
    ├── InvalidKeys             500  the file of API keys is unusable: refused at start
    └── UnusableStore           500  the database cannot be opened: refused at start
        └── UnreachableStore         it does not answer, or is busy: a later start may succeed

This module imports no other module of the project, so that every layer may raise these errors.
"""

from copy import copy
from typing import Self


class HofError(Exception):
    """Base class. `status` is the HTTP status; `title` names the kind of problem; `field` names the parameter."""

    status = 500
    title = "Internal error"

    def __init__(self, detail: str, *, field: str | None = None) -> None:
        super().__init__(detail)
        self.detail = detail
        self.field = field

    def prefixed(self, name: str) -> Self:
        """Return a copy whose detail begins with the name of the file, or of the part of the input, at fault."""
        error = copy(self)
        error.detail = f"{name}: {self.detail}"
        error.args = (error.detail,)
        return error


class InvalidInput(HofError):
    """A body that cannot be read, or a request against the rules of HTTP."""

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


class Unauthenticated(HofError):
    """No API key, or an unknown one."""

    status = 401
    title = "Unauthenticated"


class Forbidden(HofError):
    """A key without the scope that the call needs, or a page of another site."""

    status = 403
    title = "Forbidden"


class NotFound(HofError):
    """No object with this id, or no model or page of this name."""

    status = 404
    title = "Not found"


class NotAcceptable(HofError):
    """No format of the service satisfies the request's Accept header."""

    status = 406
    title = "Not acceptable"


class Stalled(HofError):
    """A request that arrives too slowly."""

    status = 408
    title = "Stalled"


class InUse(HofError):
    """An object that cannot be deleted while a composed object uses it."""

    status = 409
    title = "In use"


class TooLarge(HofError):
    """More bytes or pixels than the limit."""

    status = 413
    title = "Too large"


class UnsupportedMedia(HofError):
    """A body that is not one of the supported image types."""

    status = 415
    title = "Unsupported media type"


class Misdirected(HofError):
    """A request for a host name that this service does not answer for."""

    status = 421
    title = "Misdirected request"


class InvalidParameter(HofError):
    """A parameter that is unknown, of the wrong type or out of range; `field` names it."""

    status = 422
    title = "Invalid parameter"


class NoObjectFound(InvalidParameter):
    """An image without an object to encode."""

    title = "No object found"


class InvalidSpec(InvalidParameter):
    """A mapping spec that describes no function."""

    title = "Invalid spec"


class HeadTooLarge(HofError):
    """A request whose target and header fields have more bytes than the limit."""

    status = 431
    title = "Head too large"


class TryLater(HofError):
    """A call that may succeed if it is repeated after `retry_after_s` seconds."""

    def __init__(self, detail: str, *, field: str | None = None, retry_after_s: int = 1) -> None:
        super().__init__(detail, field=field)
        self.retry_after_s = retry_after_s


class Overloaded(TryLater):
    """More work than the service accepts at a time."""

    status = 429
    title = "Overloaded"


class RateLimited(TryLater):
    """More requests than the rate limit."""

    status = 429
    title = "Rate limited"


class NotReady(TryLater):
    """The service is starting or stopping, or a part of it does not answer."""

    status = 503
    title = "Not ready"


class StoreUnavailable(TryLater):
    """A database that does not answer, accepts no writes, or refuses for another reason that may pass."""

    status = 503
    title = "Store unavailable"


class UnsupportedVersion(HofError):
    """A request of another version of HTTP than 1.0 and 1.1."""

    status = 505
    title = "HTTP version not supported"


class StoreFull(HofError):
    """The database has no space left; nothing of the call is kept."""

    status = 507
    title = "Insufficient storage"


class InvalidModel(HofError):
    """A model file that the service cannot start with."""

    title = "Invalid model"


class InvalidKeys(HofError):
    """A file of API keys that the service cannot start with, or a key that cannot be created."""

    title = "Invalid keys"


class UnusableStore(HofError):
    """A database that the service cannot open."""

    title = "Unusable store"


class UnreachableStore(UnusableStore):
    """A database that cannot be opened at present; a later start may succeed."""

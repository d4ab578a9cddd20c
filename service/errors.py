"""What can go wrong, as classes; `service.api.app` turns each into its HTTP status.

    HofError                    500
    ├── InvalidInput            400  bytes that are not what they claim to be
    │   ├── CorruptImage
    │   └── CorruptWeights
    ├── Unauthenticated         401  no API key, or one that is not known
    ├── Forbidden               403  a key without the scope that the call needs
    ├── NotFound                404  no object of that id
    ├── Stalled                 408  a client that stopped sending
    ├── InUse                   409  an object that a composed object's word names
    ├── NotAcceptable           406  no format satisfies the Accept header
    ├── TooLarge                413  more bytes or pixels than the limit
    ├── UnsupportedMedia        415  a body that is no PNG, JPEG or WebP
    ├── InvalidParameter        422  a parameter out of range, or of the wrong kind
    │   ├── NoObjectFound            nothing to encode in the image
    │   └── InvalidSpec              a mapping spec that describes no function
    ├── HeadTooLarge            431  a request's target and fields, in bytes
    ├── TryLater                     what may succeed later, and when
    │   ├── Overloaded          429  as much work as is let in is already there
    │   ├── RateLimited         429  more requests than the rate limit
    │   └── NotReady            503  the encoder is still loading
    ├── StoreFull               507  the database has no space for what is written
    ├── InvalidModel            500  the model file is unusable: refused at start
    ├── InvalidKeys             500  the file of API keys is unusable: refused at start
    └── UnusableStore           500  the database cannot be opened: refused at start

This module imports nothing of ours, so that every layer may raise from it.
"""


class HofError(Exception):
    """Base of all our errors: `status` is HTTP's, `title` names the class of problem."""

    status = 500
    title = "Internal error"

    def __init__(self, detail: str, *, field: str | None = None) -> None:
        super().__init__(detail)
        self.detail = detail
        self.field = field


class InvalidInput(HofError):
    """Bytes that are not what they claim to be."""

    status = 400
    title = "Invalid input"


class CorruptImage(InvalidInput):
    """An image whose type is known but whose bytes cannot be decoded."""

    title = "Corrupt image"


class CorruptWeights(InvalidInput):
    """A weights file that cannot be read, or whose numbers do not fit its spec."""

    title = "Corrupt weights"


class Unauthenticated(HofError):
    """No API key, or one that is not known."""

    status = 401
    title = "Unauthenticated"


class Forbidden(HofError):
    """A key without the scope that the call needs."""

    status = 403
    title = "Forbidden"


class NotFound(HofError):
    """No object of that id."""

    status = 404
    title = "Not found"


class Stalled(HofError):
    """A body whose next bytes do not come."""

    status = 408
    title = "Stalled"


class InUse(HofError):
    """An object that cannot be removed while the word of a composed object names it."""

    status = 409
    title = "In use"


class NotAcceptable(HofError):
    """No format that we write satisfies the request's Accept header."""

    status = 406
    title = "Not acceptable"


class TooLarge(HofError):
    """More bytes or pixels than the limit."""

    status = 413
    title = "Too large"


class UnsupportedMedia(HofError):
    """A body that is none of the image types that we read."""

    status = 415
    title = "Unsupported media type"


class InvalidParameter(HofError):
    """A parameter that is unknown, of the wrong kind or out of range; `field` names it."""

    status = 422
    title = "Invalid parameter"


class NoObjectFound(InvalidParameter):
    """The image shows nothing that could be encoded."""

    title = "No object found"


class InvalidSpec(InvalidParameter):
    """A mapping spec that describes no function."""

    title = "Invalid spec"


class HeadTooLarge(HofError):
    """A request's head, its target and fields, of more bytes than the limit."""

    status = 431
    title = "Head too large"


class TryLater(HofError):
    """A call that may succeed when it comes again, after `retry_after_s` seconds."""

    def __init__(self, detail: str, *, field: str | None = None, retry_after_s: int = 1) -> None:
        super().__init__(detail, field=field)
        self.retry_after_s = retry_after_s


class Overloaded(TryLater):
    """More work than is let in."""

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


class StoreFull(HofError):
    """The database has no space left for what a call writes; nothing of it is kept."""

    status = 507
    title = "Insufficient storage"


class InvalidModel(HofError):
    """A model file that the service refuses to start with."""

    title = "Invalid model"


class InvalidKeys(HofError):
    """A file of API keys that the service refuses to start with, or a key that cannot be made."""

    title = "Invalid keys"


class UnusableStore(HofError):
    """A database that the service cannot open."""

    title = "Unusable store"

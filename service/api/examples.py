"""Examples of parameters and errors for /docs, by name and by status."""

from typing import Any, Final

from service.api.problems import problem_type

PARAMETERS: Final[dict[str, Any]] = {
    "azimuth": 30,
    "background": "auto",
    "color": "auto",
    "cursor": "NTE",
    "cx": 320,
    "cy": 240,
    "distance": 3,
    "dtype": "float16",
    "elevation": 20,
    "foreground_ratio": 0.85,
    "format": None,  # each call has formats of its own: the first is shown
    "frame": "object",
    "frames": 1,
    "fx": 620,
    "fy": 620,
    "id": "2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b",
    "include": "weights",
    "keep_photo": True,
    "limit": 50,
    "model": "hof1-k2",
    "n": 20_000,
    "name": "hof1-k2",
    "offset": 0,
    "resolution": 64,
    "roll": 0,
    "sampling": "sobol",
    "scale": 0.8,
    "seed": 7,
    "size": 320,
    "store": True,
    "version": "1",
    "view": "three-quarter",
}
ERRORS: Final[dict[str, tuple[str, str]]] = {  # status: title, detail
    "400": ("Corrupt image", "the image is truncated or corrupt"),
    "401": ("Unauthenticated", "this call needs an API key: `Authorization: Bearer KEY`, or `X-API-Key: KEY`"),
    "403": ("Forbidden", "this call needs a key of the scope write"),
    "404": ("Not found", "no object has the id 2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"),
    "406": ("Not acceptable", "the Accept header allows none of image/png, image/webp"),
    "408": ("Stalled", "the body came too slowly: no byte for 30 s, or fewer than 8192 a second"),
    "409": ("In use", "composed objects use it: 9b1d1c4d5e6f7a8b2f7f3b52a9a1c0de; delete them first"),
    "413": ("Too large", "the body has 20971521 bytes, the limit is 20971520"),
    "415": ("Unsupported media type", "the body is not a PNG, JPEG, WebP, AVIF or HEIC image"),
    "421": (
        "Misdirected request",
        "this service has no API keys and does not answer for the host shop.example; allow that name with "
        "--allowed-hosts (HOF_ALLOWED_HOSTS)",
    ),
    "422": ("Invalid parameter", "n: Input should be less than or equal to 10000000"),
    "429": (
        "Overloaded",
        "the service works on its limit of 128 images at a time (--max-queued-images): repeat the call after "
        "Retry-After",
    ),
    "503": ("Not ready", "the service is starting or stopping"),
    "507": ("Insufficient storage", "the database has no space left; nothing of this call is kept"),
}


def parameter_example(parameter: dict[str, Any]) -> object:
    """Return an example of a parameter in the schema."""
    example = PARAMETERS[parameter["name"]]
    return parameter["schema"]["enum"][0] if example is None else example


def problem_example(status: str) -> dict[str, Any]:
    """Return an example of an error answer."""
    title, detail = ERRORS[status]
    example = {"type": problem_type(title), "title": title, "status": int(status), "detail": detail}
    if status == "422":
        field, _, message = detail.partition(": ")
        example["errors"] = [{"field": field, "message": message}]
    return example | {"error": detail}

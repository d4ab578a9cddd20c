"""Request bodies with a limit: bytes are counted as they arrive, chunked bodies included."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import Field, File, FormParser, parse_options_header
from starlette.requests import ClientDisconnect, Request

from service.errors import InvalidInput, InvalidParameter, TooLarge
from service.formats.scans.read import kind_of
from service.labels import clean_label
from service.runtime.admission import Admitted, ClientLeft
from service.runtime.inputs.views import MAX_IMAGES

FIELDS: Final = ("image", "points", "label")
MAX_DELIMITERS: Final = 64  # of a form; a form of two fields has three
MAX_PADDING: Final = 64  # spaces and tabs after a delimiter; nobody sends any
FORM_OVERHEAD_BYTES: Final = 16_384  # boundaries and headers of a form, and its label


class Upload(NamedTuple):
    """The images of a request, all of one object, or a file of points or a mesh; and the label for the object."""

    images: tuple[bytes, ...]
    label: str | None = None
    points: bytes | None = None


async def read_body(request: Request, max_bytes: int, admitted: Admitted | None = None) -> bytes:
    """Return the whole body. Its bytes count in the gate of `admitted` as they arrive, not as they are declared.

    Raises
    ------
    TooLarge : the body exceeds `max_bytes`; raised as early as possible.
    Overloaded : the gate of `admitted` is full, or has no room for the declared length.
    ClientLeft : the client disconnected before the end of the body.
    """
    declared = request.headers.get("content-length", "")
    size = int(declared) if declared.isdecimal() else 1
    if size > max_bytes:
        raise TooLarge(f"the body has {declared} bytes, the limit is {max_bytes}")
    if admitted is not None:
        admitted.check(size)
    body = bytearray()
    try:
        async for chunk in request.stream():
            if len(body) + len(chunk) > max_bytes:
                raise TooLarge(f"the body has more than {max_bytes} bytes, the limit")
            body += chunk
            if admitted is not None:
                admitted.grow_to(len(body))
    except ClientDisconnect as error:
        raise ClientLeft from error
    return bytes(body)


async def read_upload(request: Request, max_bytes: int, admitted: Admitted) -> Upload:
    """Return the images or points of a request: the fields of a form, or the raw body of any other content type.

    A raw body is a file of points, or a mesh, if its content is one.

    Its bytes count in the gate of `admitted` as they arrive.

    Raises
    ------
    TooLarge : the images together exceed `max_bytes`.
    Overloaded : the gate is full.
    InvalidInput : the form is malformed.
    InvalidParameter : the form has other fields than `image`, 1 to MAX_IMAGES times, or one `points`, and one `label`;
        the same image twice; or a label that is none.
    ClientLeft : the client disconnected before the end of the body.
    """
    content_type, options = parse_options_header(request.headers.get("content-type"))
    if content_type != b"multipart/form-data":
        body = await read_body(request, max_bytes, admitted)
        return Upload((body,)) if kind_of(body) is None else Upload((), points=body)
    body = await read_body(request, max_bytes + FORM_OVERHEAD_BYTES, admitted)
    upload = parse_form(body, options.get(b"boundary", b""))
    if (size := sum(map(len, upload.images))) > max_bytes:
        subject = "image has" if len(upload.images) == 1 else "images together have"
        raise TooLarge(f"the {subject} {size} bytes, the limit is {max_bytes}", field="image")
    if upload.points is not None and len(upload.points) > max_bytes:
        raise TooLarge(f"the points have {len(upload.points)} bytes, the limit is {max_bytes}", field="points")
    return upload


def parse_form(body: bytes, boundary: bytes) -> Upload:
    """Return the fields of a multipart form: images and, if it is there, `label`. Raises as `read_upload` does."""
    _check_delimiters(body, boundary)
    fields: dict[str, list[bytes]] = {name: [] for name in FIELDS}
    ended: list[bool] = []

    def take(name: bytes | None, value: bytes) -> None:
        # Refusing at once keeps a form of a million tiny parts from being parsed to its end.
        field = (name or b"")[:64].decode("latin-1")
        if field not in FIELDS:
            raise InvalidParameter("the form may have the fields image or points, and label, no others", field=field)
        limit = MAX_IMAGES if field == "image" else 1
        if len(fields[field]) == limit:
            raise InvalidParameter(f"the form has the field {field} more than {limit} times, the limit", field=field)
        fields[field].append(value)

    def take_file(file: File) -> None:
        file.file_object.seek(0)
        take(file.field_name, file.file_object.read())

    def take_field(field: Field) -> None:
        take(field.field_name, field.value or b"")

    try:
        parser = FormParser(
            "multipart/form-data",
            take_field,
            take_file,
            on_end=lambda: ended.append(True),
            boundary=boundary,
            config={"MAX_MEMORY_FILE_SIZE": len(body) + 1, "UPLOAD_ERROR_ON_BAD_CTE": True},  # nothing on disk
        )
        parser.write(body)
    except FormParserError as error:
        raise InvalidInput("the multipart form is malformed", field="image") from error
    if not ended:
        raise InvalidInput("the multipart form is malformed: its last boundary is missing", field="image")
    return _upload(fields)


def _upload(fields: Mapping[str, list[bytes]]) -> Upload:
    """Return the fields of a form, by name. Raises InvalidParameter for a combination that makes no object."""
    images, points, labels = (fields[name] for name in FIELDS)
    if not images and not points:
        raise InvalidParameter("the form lacks the field image, or points", field="image")
    if images and points:
        raise InvalidParameter("the form has both image and points: send one of them", field="points")
    _check_distinct(images)
    return Upload(tuple(images), _label(b"".join(labels)), points[0] if points else None)


def _check_distinct(images: Sequence[bytes]) -> None:
    """Raise InvalidParameter for the same image twice, which would weigh twice in the mean of the views."""
    for number, image in enumerate(images):
        if (first := images.index(image)) < number:
            detail = f"image {number + 1} of {len(images)} is the same file as image {first + 1}: send each view once"
            raise InvalidParameter(detail, field="image")


def _label(value: bytes) -> str | None:
    try:
        return clean_label(value.decode())
    except UnicodeDecodeError as error:
        raise InvalidParameter("the label is not UTF-8", field="label") from error


def _check_delimiters(body: bytes, boundary: bytes) -> None:
    """Raise InvalidInput if a form has more delimiters, or more spaces after one, than the limits.

    The parser runs on the event loop and steps in Python through each, even if it turns out to be data of the field.
    """
    delimiter, count, at = b"\r\n--" + boundary, 0, 0
    while (at := body.find(delimiter, at)) >= 0:
        count, at = count + 1, at + len(delimiter)
        if count > MAX_DELIMITERS:
            raise InvalidInput(
                f"the form has its boundary more than {MAX_DELIMITERS} times, the limit: send the fields image "
                "and label, and a boundary that is not in them",
                field="image",
            )
        padding = body[at : at + MAX_PADDING + 1]
        if len(padding) > MAX_PADDING and not padding.strip(b" \t"):
            raise InvalidInput(
                f"the form has more than {MAX_PADDING} spaces after a boundary, the limit: send none", field="image"
            )

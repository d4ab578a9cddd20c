"""Calls about objects: make them, list them, read them, label them, remove them."""

import json
import secrets
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Literal

from hof_client.answers import (
    CompletedObject,
    CompletedWeights,
    ComposedObjects,
    EncodedObject,
    EncodedWeights,
    ObjectPage,
    StoredObject,
)
from hof_client.bodies import Whole, json_reader
from hof_client.request import Call, Request

Background = Literal["auto", "keep", "remove"]
MAX_LIMIT = 500  # objects of a page

File = bytes | str | PathLike[str]  # bytes, or a file's path


def encode(
    image: File,
    *,
    background: Background = "auto",
    foreground_ratio: float | None = None,
    include: Literal["weights"] | None = None,
    model: str | None = None,
    label: str | None = None,
    keep_photo: bool = False,
) -> Call[EncodedObject]:
    """Turn the photo of one object into an object, and keep it. The same photo gives the same object.

    Parameters
    ----------
    image : bytes or path of a PNG, JPEG, WebP or AVIF.
    background : `auto` removes the background if it can tell, `remove` insists on that, `keep` leaves it.
    foreground_ratio : share of the encoder's input that the object's longer side fills, 0.1 to 1; by default the
        model's own.
    include : "weights" adds theta to the answer.
    model : name of a loaded model; by default the first.
    label : name of the object, one line of at most 80 characters; kept unless the object has one already.
    keep_photo : keep a small picture of the photo's object, for `photo`.

    Raises
    ------
    NoObjectFound, CorruptImage, TooLarge, UnsupportedMedia, StoreFull : see `hof_client.problems`.
    """
    query = {
        "background": background,
        "foreground_ratio": foreground_ratio,
        "include": include,
        "model": model,
        "keep_photo": keep_photo,
    }
    content, headers = _form("image", [image], label) if label else (_bytes_of(image), {})
    request = Request("POST", "/encode", query=query, content=content, headers=headers)
    return Call(request, json_reader(EncodedObject))


def encode_views(
    photos: Sequence[File],
    *,
    background: Background = "auto",
    foreground_ratio: float | None = None,
    include: Literal["weights"] | None = None,
    model: str | None = None,
    label: str | None = None,
    keep_photo: bool = False,
) -> Call[EncodedObject]:
    """Turn several photos of one object, from different sides, into one object. Parameters and errors as in `encode`.

    Parameters
    ----------
    photos : 1 to 8, all different, together no larger than one may be. `images` of the answer reports on each.
    keep_photo : keep a small picture of the object in the first photo.
    """
    query = {
        "background": background,
        "foreground_ratio": foreground_ratio,
        "include": include,
        "model": model,
        "keep_photo": keep_photo,
    }
    content, headers = _form("image", photos, label)
    request = Request("POST", "/encode", query=query, content=content, headers=headers)
    return Call(request, json_reader(EncodedObject))


def encode_only(
    image: File,
    *,
    background: Background = "auto",
    foreground_ratio: float | None = None,
    model: str | None = None,
) -> Call[EncodedWeights]:
    """Turn a photo into weights, and keep nothing. Parameters and errors as in `encode`."""
    query = {"store": False, "background": background, "foreground_ratio": foreground_ratio, "model": model}
    request = Request("POST", "/encode", query=query, content=_bytes_of(image))
    return Call(request, json_reader(EncodedWeights))


def encode_points(
    points: File,
    *,
    include: Literal["weights"] | None = None,
    model: str | None = None,
    label: str | None = None,
) -> Call[CompletedObject]:
    """Turn points of a part of an object, or a mesh, into the whole object, and keep it.

    `placement` of the answer tells where the object lies in the frame of the points.

    Parameters
    ----------
    points : bytes or path of PLY, PCD, NPY or XYZ points, 64 or more, or of a GLB, OBJ or STL mesh.
    include, model, label : as in `encode`; by default the first model that takes points.

    Raises
    ------
    UnsupportedMedia : another format, or no model that takes points is loaded.
    InvalidInput, InvalidParameter, TooLarge, StoreFull : see `hof_client.problems`.
    """
    content, headers = _form("points", [points], label)
    request = Request("POST", "/encode", query={"include": include, "model": model}, content=content, headers=headers)
    return Call(request, json_reader(CompletedObject))


def encode_points_only(points: File, *, model: str | None = None) -> Call[CompletedWeights]:
    """Turn points into weights, and keep nothing. Parameters and errors as in `encode_points`."""
    content, headers = _form("points", [points], None)
    request = Request("POST", "/encode", query={"store": False, "model": model}, content=content, headers=headers)
    return Call(request, json_reader(CompletedWeights))


def import_object(weights: File) -> Call[StoredObject]:
    """Keep a weights file (safetensors: bytes or a path) as an object. Raises CorruptWeights or InvalidSpec."""
    request = Request("POST", "/objects", content=_bytes_of(weights))
    return Call(request, json_reader(StoredObject))


def objects(*, limit: int = 50, cursor: str | None = None) -> Call[ObjectPage]:
    """Return a page of at most `limit` (1 to 500) objects, newest first. `iter_objects` goes through all."""
    request = Request("GET", "/objects", query={"limit": limit, "cursor": cursor})
    return Call(request, json_reader(ObjectPage))


def object_(object_id: str) -> Call[StoredObject]:
    """Return one object. Raises NotFound."""
    return Call(Request("GET", "/objects/{id}", {"id": object_id}), json_reader(StoredObject))


def set_label(object_id: str, label: str | None) -> Call[StoredObject]:
    """Give an object another label, one line of at most 80 characters; None removes it. Raises NotFound."""
    content = json.dumps({"label": label}).encode()
    headers = {"Content-Type": "application/json"}
    request = Request("PATCH", "/objects/{id}", {"id": object_id}, content=content, headers=headers)
    return Call(request, json_reader(StoredObject))


def delete(object_id: str) -> Call[None]:
    """Remove an object. Raises NotFound, or InUse while a composed object uses it.

    After `ConnectionFailed` it may be removed or not: this is the one call that is not repeated by itself then.
    """
    request = Request("DELETE", "/objects/{id}", {"id": object_id}, media_type="", is_repeatable=False)
    return Call(request, lambda _: Whole(lambda _: None))


def compose(objects: Sequence[str]) -> Call[StoredObject]:
    """Make the composed object of a word: of the ids A, B the function f_A(f_B(x)). Raises NotFound, InvalidParameter.

    The word has as many ids as the objects' spec says (`spec.k`).
    """
    return Call(_compose(objects, "compose"), json_reader(StoredObject))


def interpolate(objects: Sequence[str]) -> Call[StoredObject]:
    """Make an object whose theta is the mean of two or more objects'. Raises NotFound, InvalidParameter."""
    return Call(_compose(objects, "interpolate"), json_reader(StoredObject))


def compose_all(objects: Sequence[str]) -> Call[ComposedObjects]:
    """Make all 2^k words over two objects, in lexicographic order: AA, AB, BA, BB. Errors as `compose`."""
    return Call(_compose(objects, "all"), json_reader(ComposedObjects))


def _compose(objects: Sequence[str], mode: str) -> Request:
    content = json.dumps({"objects": list(objects), "mode": mode}).encode()
    return Request("POST", "/compose", content=content, headers={"Content-Type": "application/json"})


def _form(name: str, files: Sequence[File], label: str | None) -> tuple[bytes, dict[str, str]]:
    """Return a multipart form of files in fields of one name and of their label, and its headers."""
    boundary = secrets.token_hex(16)
    field = f'--{boundary}\r\nContent-Disposition: form-data; name="'
    parts = [f'{field}label"\r\n\r\n{label}\r\n'.encode()] if label else []
    for file in files:
        parts += [f'{field}{name}"; filename="{name}"\r\n\r\n'.encode(), _bytes_of(file), b"\r\n"]
    content = b"".join([*parts, f"--{boundary}--\r\n".encode()])
    return content, {"Content-Type": f"multipart/form-data; boundary={boundary}"}


def _bytes_of(file: File) -> bytes:
    return file if isinstance(file, bytes) else Path(file).read_bytes()

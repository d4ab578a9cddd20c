"""`hof encode`: photos of an object, or points of a part of it, become points or weights of the whole object."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from service.cli.files import (
    STDIO,
    options_of,
    point_options,
    read_file,
    settings_of,
    shown_name,
    suffix_of,
    write_file,
    write_points,
)
from service.encoding.completion import complete
from service.encoding.encoder import Encoded, Encoder, Input
from service.encoding.framing import Framed, preprocess
from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.encoding.report import ImageReport
from service.errors import HofError, InvalidParameter
from service.formats.scans.read import kind_of, read_points
from service.formats.weights import WEIGHT_FORMATS, Weights, dump
from service.labels import clean_label
from service.mapping.box import measure
from service.mapping.frame import Frame
from service.runtime.inputs.scans import Placement
from service.runtime.inputs.views import MAX_IMAGES, averaged
from service.runtime.options import EncodeOptions
from service.settings import Settings


def encode(arguments: argparse.Namespace) -> None:
    """Encode the photo of one object, or several views of it, and write its points, or its weights as .safetensors.

    Points of a part of an object, or a mesh (PLY, PCD, NPY, XYZ; GLB, OBJ, STL), become the whole object, if a model
    takes them. stderr tells how the object was separated from its background, or where it lies among the points.
    """
    settings = settings_of(arguments)
    label = clean_label(arguments.label)
    if suffix_of(arguments) != WEIGHT_FORMATS["safetensors"].extension:
        if label:
            raise InvalidParameter("only a weights file has a label: write one with -o NAME.safetensors", field="label")
        point_options(arguments)  # fails before the work begins
    paths = [arguments.photo, *arguments.view]
    if paths.count(STDIO) > 1:
        raise InvalidParameter("- is named twice, and stdin holds one photo: name a file", field="view")
    first = read_file(paths[0])
    if kind_of(first) is None:
        _encode_photos(arguments, settings, paths, first)
    else:
        _complete(arguments, settings, paths, first)


def _encode_photos(arguments: argparse.Namespace, settings: Settings, paths: Sequence[Path], first: bytes) -> None:
    encoder = _encoder(settings, "image")
    matting = Matting.of(settings.matting_model, settings.threads)
    views = _framed_views(arguments, paths, first, settings, encoder, matting)
    encoded = [encoder.encode_photo(view) for view in views]
    reports = [ImageReport.of(view) for view in views]
    functions = averaged(encoded)
    result = _write(arguments, encoder, functions, measure(encoder.spec, functions.theta), reports[0])
    lines = []
    for path, report, each in zip(paths, reports, encoded, strict=True):
        hint = "; matting is off (--matting-model none)" if report.mask == "none" and matting is None else ""
        lines.append(f"{shown_name(path)}: {report}{hint}")
        lines += [f"{shown_name(path)}: {each.estimates.rounded()}"] if each.estimates else []
    lines.append(result)
    print(*(f"hof: {each}" for each in lines), sep="\n", file=sys.stderr)


def _complete(arguments: argparse.Namespace, settings: Settings, paths: Sequence[Path], data: bytes) -> None:
    """Encode a file of points or a mesh."""
    name = shown_name(paths[0])
    if len(paths) > 1:
        raise InvalidParameter(f"{name} has points: --view is for photos", field="view")
    encoder = _encoder(settings, "points")
    try:
        sent, functions = complete(encoder, read_points(data))
    except HofError as error:
        raise error.prefixed(name) from error
    frame = measure(encoder.spec, functions.theta)
    result = _write(arguments, encoder, functions, frame, None)
    print(f"hof: {name}: {Placement.of(sent, frame)}", f"hof: {result}", sep="\n", file=sys.stderr)


def _encoder(settings: Settings, takes: Input) -> Encoder:
    """Return the first of the models that takes the input."""
    return Models.open(settings.model, settings.threads).named(None, takes)


def _write(
    arguments: argparse.Namespace, encoder: Encoder, functions: Encoded, frame: Frame, report: ImageReport | None
) -> str:
    """Write the weights or the points, and return a line that says which."""
    name = shown_name(arguments.output)
    if suffix_of(arguments) == WEIGHT_FORMATS["safetensors"].extension:
        theta, color, label = functions.theta, functions.color, clean_label(arguments.label)
        weights = Weights(encoder.spec, theta, encoder.name, color=color, frame=frame, label=label)
        write_file(arguments.output, [dump(weights, "safetensors")])
        return f"{name}: weights of {encoder.name}"
    count = write_points(arguments, encoder.spec, functions, frame, functions.estimates, report)
    return f"{name}: {count} points"


def _framed_views(
    arguments: argparse.Namespace,
    paths: Sequence[Path],
    first: bytes,
    settings: Settings,
    encoder: Encoder,
    matting: Matting | None,
) -> list[Framed]:
    """Return the photos, framed; `first` has the bytes of the first. An error names the file."""
    if len(paths) > MAX_IMAGES:
        raise InvalidParameter(f"there are {len(paths)} photos, the limit is {MAX_IMAGES} of one object", field="view")
    options = options_of(arguments, EncodeOptions)
    framing = encoder.framing.with_ratio(options.foreground_ratio)
    photos: list[bytes] = []
    views = []
    for path in paths:
        photo = read_file(path) if photos else first
        if photo in photos:
            same = shown_name(paths[photos.index(photo)])
            raise InvalidParameter(f"{shown_name(path)} is the same photo as {same}: name each once", field="view")
        photos.append(photo)
        try:
            views.append(preprocess(photo, framing, options.background, settings.max_image_pixels, matting))
        except HofError as error:
            raise error.prefixed(shown_name(path)) from error
    return views

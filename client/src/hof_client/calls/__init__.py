"""The calls of the service, one function each: arguments in, a `Call` out. Nothing here sends anything."""

from hof_client.calls.inference import (
    infer,
    inference_config,
    inference_live,
    inference_model,
    inference_model_ready,
    inference_ready,
    inference_server,
)
from hof_client.calls.objects import (
    MAX_LIMIT,
    compose,
    compose_all,
    delete,
    encode,
    encode_only,
    import_object,
    interpolate,
    objects,
    set_label,
)
from hof_client.calls.objects import object_ as object  # noqa: A004 - the name of the method
from hof_client.calls.paths import path, path_file
from hof_client.calls.service import live, metrics, model, models, ready
from hof_client.calls.shapes import (
    colored_points,
    iter_points,
    mesh,
    photo,
    picture,
    points,
    save_points,
    theta,
    weights,
)

__all__ = [
    "MAX_LIMIT",
    "colored_points",
    "compose",
    "compose_all",
    "delete",
    "encode",
    "encode_only",
    "import_object",
    "infer",
    "inference_config",
    "inference_live",
    "inference_model",
    "inference_model_ready",
    "inference_ready",
    "inference_server",
    "interpolate",
    "iter_points",
    "live",
    "mesh",
    "metrics",
    "model",
    "models",
    "object",
    "objects",
    "path",
    "path_file",
    "photo",
    "picture",
    "points",
    "ready",
    "save_points",
    "set_label",
    "theta",
    "weights",
]

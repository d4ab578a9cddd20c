"""File formats of points, surfaces and weights: pure functions from arrays to bytes and back.

`points.registry`, `mesh.registry` and `weights` list the formats; README.md in this folder says how to add one.
"""

from service.formats.mesh.registry import MESH_FORMATS, MeshFormat
from service.formats.points.registry import POINT_FORMATS, PointFormat
from service.formats.points.writer import write as write_points
from service.formats.weights import WEIGHT_FORMATS, WeightFormat, WeightFormatName, Weights
from service.formats.weights import dump as dump_weights
from service.formats.weights import load as load_weights

__all__ = [
    "MESH_FORMATS",
    "POINT_FORMATS",
    "WEIGHT_FORMATS",
    "MeshFormat",
    "PointFormat",
    "WeightFormat",
    "WeightFormatName",
    "Weights",
    "dump_weights",
    "load_weights",
    "write_points",
]

"""The mapping function: spec and theta, canonical points, and what they give: points, colors, clouds, surfaces.

This package needs NumPy and nothing of the service but its errors. A library user imports from here; the code of this
project imports from the modules.
"""

from service.mapping.box import measure
from service.mapping.canonical import Sampling, canonical_points
from service.mapping.cloud import Cloud
from service.mapping.color import ColorSampler
from service.mapping.frame import Frame
from service.mapping.sampler import Sampler, sample
from service.mapping.spec import (
    DOMAIN_DIMS,
    HOF_1,
    HOF_3,
    Activation,
    Array,
    Color,
    Colors,
    Domain,
    Functions,
    MappingSpec,
    apply,
    compose,
    initial_theta,
    join_functions,
    layers,
    power,
    word_of,
)
from service.mapping.surface import Surface, surface_of

__all__ = [
    "DOMAIN_DIMS",
    "HOF_1",
    "HOF_3",
    "Activation",
    "Array",
    "Cloud",
    "Color",
    "ColorSampler",
    "Colors",
    "Domain",
    "Frame",
    "Functions",
    "MappingSpec",
    "Sampler",
    "Sampling",
    "Surface",
    "apply",
    "canonical_points",
    "compose",
    "initial_theta",
    "join_functions",
    "layers",
    "measure",
    "power",
    "sample",
    "surface_of",
    "word_of",
]

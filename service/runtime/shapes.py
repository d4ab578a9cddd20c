"""Build the cloud or the surface of an object that options ask for."""

from service.mapping.cloud import Cloud
from service.mapping.color import ColorSampler
from service.mapping.frame import Frame
from service.mapping.pose import Pose
from service.mapping.sampler import Sampler
from service.mapping.spec import Functions, MappingSpec, word_of
from service.mapping.surface import Surface, surface_of
from service.runtime.options import ColorChoice, MeshOptions, PointOptions, ShapeFrame


def functions_for(functions: Functions, color: ColorChoice, *, holds_color: bool = True) -> Functions:
    """Return the functions to evaluate: without colors if `color` is "none" or the format holds none."""
    return functions if color == "auto" and holds_color else Functions(functions.theta)


def cloud_of(
    spec: MappingSpec, functions: Functions, frame: Frame, options: PointOptions, pose: Pose | None = None
) -> Cloud:
    """Return the cloud of an object, of which nothing is computed yet. Raises InvalidParameter.

    Parameters
    ----------
    pose : for the frame of a camera.
    """
    return Cloud(
        spec,
        functions_for(functions, options.color),
        options.n,
        options.seed,
        options.offset,
        options.scale,
        options.sampling,
        _frame_for(frame, options.frame),
        pose,
    )


def mesh_of(
    spec: MappingSpec, functions: Functions, frame: Frame, options: MeshOptions, pose: Pose | None = None
) -> Surface:
    """Compute the surface of an object, with colors if `functions` has them: see `functions_for`.

    Parameters
    ----------
    pose : for the frame of a camera.

    Raises
    ------
    CorruptWeights : the values of the functions exceed float32.
    """
    sampler = Sampler(spec, word_of(spec, functions.theta), _frame_for(frame, options.frame))
    color = ColorSampler(functions.color) if functions.color else None
    surface = surface_of(sampler, options.resolution, options.scale, color)
    return surface.seen(pose, options.scale) if pose else surface


def _frame_for(frame: Frame, choice: ShapeFrame) -> Frame | None:
    """Return the frame to compute in: None for the function's own numbers."""
    return None if choice == "raw" else frame

"""The compiled kernel: Philox's random numbers and the values of networks, in C (service/mapping/kernel).

Points are the lanes of vectors. Where a network has one hidden layer, its units follow one another, so the layer is
never stored. Those of deeper networks stay in the cache, for a tile of points. setup.py builds the kernel where it
finds a C compiler. Elsewhere NumPy computes the points.
"""

import functools
import importlib
from types import ModuleType
from typing import Final, Protocol, cast

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
Starts = npt.NDArray[np.int64]
Widths = npt.NDArray[np.int64]

NAME: Final = "service.mapping._kernel"
NOT_BUILT: Final = (
    "no compiled kernel of this version, so NumPy computes points, more slowly: "
    "install a C compiler with Python's headers, then this package anew"
)
VERSION: Final = 4  # of the kernel's source, as in kernel.c: raise both with each change of what it computes
ROW: Final = 7  # floats of a packed unit: its row of [W b], its column of V


class Kernel(Protocol):
    """The functions of `service.mapping._kernel`.

    They take C-contiguous arrays, run without Python's lock and write results to their last arguments. Other types and
    shapes raise ValueError.

    Attributes
    ----------
    SETS : the processor's instruction sets that the kernel has code for, best first, and the number of each.
    """

    SETS: dict[str, int]

    def uniform(self, key: int, counter: int, u: Array, /) -> None:
        """Take n / 2 steps of Philox 4x64-10 after `counter`: u (4, n), n even, in [0, 1)."""

    def cut(
        self,
        first: Array,
        second: Array,
        grid: int,
        low: Array,
        step: Array,
        half: Array,
        affine: Array,
        crossing: Mask,
        instructions: int = ...,
        /,
    ) -> None:
        """Find the linear units of each cell of a fold (`service.mapping.folding.Fold`), and add them up.

        Parameters
        ----------
        first, second : [W b] (h, 4), V (3, h).
        low, step, half : (3,) low corner of the box; sides of a cell, and what counts as half of them.
        affine, crossing : (grid ** 3 + 1, 3, 4), (grid ** 3 + 1, h); the last cell, outside the box, stays as it is.
        instructions : as for `map`.
        """

    def pack(self, crossing: Mask, units: Array, starts: Starts, packed: Array, /) -> None:
        """Write the units of each cell one after another.

        Parameters
        ----------
        crossing : (cells, h), the units of each cell.
        units : (h, 7), a row of [W b] and a column of V each.
        starts : (cells + 1,), the first unit of each cell, and the end.
        packed : (crossing.sum(), 7).
        """

    def outermost(self, values: Array, places: Starts, heights: Array, /) -> None:
        """Find the outermost points of each direction: values (3, n); places (6, count), heights (6, count)."""

    def spread(self, candidates: Array, around: Array, radius: float, domain: int, trials: Array, /) -> None:
        """Place trials around each candidate, within the domain (0 cube, 1 ball, 2 sphere).

        Parameters
        ----------
        candidates, around : (d, searches), (d, each).
        trials : (d, searches * each), those of a candidate one after another.
        """

    def climb(self, values: Array, trials: Array, candidates: Array, reached: Array, /) -> None:
        """Move each candidate to its outermost trial if that is farther out.

        Parameters
        ----------
        values, trials : (3, n), (d, n), as `spread` places them.
        candidates, reached : (d, searches), (searches,), a sixth for each direction; both are overwritten.
        """

    def network(
        self, x: Array, theta: Array, widths: Widths, is_tanh: bool, y: Array, instructions: int = ..., /
    ) -> None:
        """Compute the values of a network, theta as in `service.mapping.spec`, at points.

        Parameters
        ----------
        x, y : (inputs, n), (outputs, n).
        widths : (layers + 1,), the network's inputs, hidden layers and outputs.
        is_tanh : tanh follows each hidden layer; ReLU otherwise.
        instructions : as for `map`.
        """

    def map(
        self,
        x: Array,
        origin: Array,
        per_unit: Array,
        grid: int,
        starts: Starts,
        packed: Array,
        affine: Array,
        y: Array,
        instructions: int = ...,
        /,
    ) -> None:
        """Compute the values of a fold (`service.mapping.folding.Fold`), packed, at points: x, y (3, n).

        `instructions` is a number of `SETS`; the best by default.
        """


def extension(name: str, version: int) -> ModuleType | None:
    """Return a compiled module, or None if it was not built, or from another version of its source."""
    try:
        module = importlib.import_module(name)
    except ImportError:
        return None
    return module if getattr(module, "VERSION", 0) == version else None


@functools.cache
def load() -> Kernel | None:
    """Return the compiled kernel, or None if there is none of this version."""
    return cast(Kernel | None, extension(NAME, VERSION))

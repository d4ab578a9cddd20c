"""Numbers of points and meshes as they are read, and limits of what the bytes of a file can unfold to."""

from typing import Final

import numpy as np
import numpy.typing as npt

Doubles = npt.NDArray[np.float64]

MAX_POINTS: Final = 2_000_000
MAX_TRIANGLES: Final = 2_000_000
MAX_NODES: Final = 10_000  # of a glTF scene, each instance counted
MAX_HEADER: Final = 65_536  # bytes

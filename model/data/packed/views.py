"""Count the training images of a data set."""

import json
from pathlib import Path

import numpy as np

from model.data.manifest import Manifest, Split
from model.data.packed.shards import INDEX


def count_views(data: Path, split: Split, packed: str | None = None) -> int:
    """Return the views of a split's objects as built, or of all its shapes in a packed data set.

    Every object is taken to have as many views as the first.

    Raises
    ------
    FileNotFoundError : no such data set, or an empty split.
    """
    if packed:
        index = json.loads((Path(packed) / INDEX).read_text(encoding="utf-8"))
        return sum(int(shard["views"].get(split, 0)) for shard in index["shards"])
    entries = list(Manifest.read(data).of(split))
    if not entries:
        raise FileNotFoundError(f"{data} holds no objects of the split {split}")
    with np.load(data / entries[0].file) as arrays:
        return len(entries) * len(arrays["views"])

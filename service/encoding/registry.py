"""The loaded image encoders, by name."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from service.encoding.encoder import Encoder
from service.errors import InvalidModel, InvalidParameter


class Models:
    """Encoders in the order of their files. There is at least one, and the first is the default."""

    def __init__(self, encoders: Sequence[Encoder]) -> None:
        self._by_name = {encoder.name: encoder for encoder in encoders}

    @classmethod
    def open(cls, paths: Sequence[Path], threads: int) -> "Models":
        """Load model files, each to run on `threads` threads.

        Raises
        ------
        InvalidModel : a file is unusable (see `Encoder.open`), or two models have the same name.
        """
        files: dict[str, Path] = {}
        encoders = []
        for path in paths:
            encoder = Encoder.open(path, threads)
            if encoder.name in files:
                raise InvalidModel(
                    f"the models {files[encoder.name]} and {path} are both named {encoder.name}: load one of them"
                )
            files[encoder.name] = path
            encoders.append(encoder)
        return cls(encoders)

    def __iter__(self) -> Iterator[Encoder]:
        return iter(self._by_name.values())

    def named(self, name: str | None) -> Encoder:
        """Return the encoder of that name; None means the default. Raises InvalidParameter, with the loaded names."""
        if name is None:
            return next(iter(self))
        if name not in self._by_name:
            loaded = ", ".join(self._by_name)
            raise InvalidParameter(f"no loaded model is named {name!r}; there is {loaded}", field="model")
        return self._by_name[name]

    def warm_up(self) -> None:
        """Run one inference of each encoder."""
        for encoder in self:
            encoder.warm_up()

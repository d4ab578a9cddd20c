"""The loaded image encoders, by name."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from service.encoding.encoder import Encoder, Input
from service.errors import InvalidModel, InvalidParameter, UnsupportedMedia


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

    def named(self, name: str | None, takes: Input | None = None) -> Encoder:
        """Return the encoder of that name; None means the first, of those that take the input.

        Raises
        ------
        InvalidParameter : no model has that name, or it takes another input.
        UnsupportedMedia : no name is given, and no loaded model takes the input.
        """
        if name is None:
            fitting = (encoder for encoder in self if takes in (None, encoder.takes))
            if (encoder := next(fitting, None)) is None:
                kind = "points or meshes" if takes == "points" else "images"
                raise UnsupportedMedia(f"no model for {kind} is loaded: name one with --model or HOF_MODEL")
            return encoder
        if name not in self._by_name:
            loaded = ", ".join(self._by_name)
            raise InvalidParameter(f"no loaded model is named {name!r}; there is {loaded}", field="model")
        encoder = self._by_name[name]
        if takes not in (None, encoder.takes):
            own = "points or a mesh" if encoder.takes == "points" else "an image"
            raise InvalidParameter(f"the model {name} takes {own}: send that, or name another model", field="model")
        return encoder

    def warm_up(self) -> None:
        """Run one inference of each encoder."""
        for encoder in self:
            encoder.warm_up()

    def rest(self) -> None:
        """Free the memory of all encoders but the default one, until they are called."""
        for encoder in list(self)[1:]:
            encoder.rest()

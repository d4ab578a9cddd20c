"""Record of one experiment of the paper: its setting, and figures of each method on each object."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from service.files import whole_file

DIGITS: Final = 5

Values = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trial:
    """Figures of one method: one value per object; None where the figure does not exist for an object."""

    method: str
    figures: dict[str, list[float | None]]

    def column(self, figure: str) -> Values:
        """Return a figure of every object, (objects,), NaN where it does not exist."""
        return np.array(self.figures[figure], np.float64)


@dataclass(frozen=True)
class PaperRecord:
    """Measurements of one experiment.

    setting : what was measured and how: split, counts, steps.
    origin : model, seed, machine, date, commit. The file's key is `made`.
    ids, classes : of the objects, in manifest order.
    """

    experiment: str
    setting: dict[str, Any]
    origin: dict[str, Any]
    ids: list[str]
    classes: list[str]
    trials: list[Trial]

    def trial(self, method: str) -> Trial:
        """Return the figures of a method. Raises KeyError if it was not measured."""
        return {trial.method: trial for trial in self.trials}[method]

    def write(self, path: Path) -> None:
        """Write as JSON, one line per method, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        fields = {"experiment": self.experiment, "setting": self.setting, "made": self.origin}
        fields |= {"ids": self.ids, "classes": self.classes}
        lines = [f" {json.dumps(name)}: {json.dumps(value, ensure_ascii=False)}" for name, value in fields.items()]
        rows = ",\n  ".join(json.dumps(asdict(trial)) for trial in self.trials)
        with whole_file(path) as file:
            file.write(("{\n" + ",\n".join(lines) + f',\n "trials": [\n  {rows}\n ]\n}}\n').encode())

    @classmethod
    def read(cls, path: Path) -> "PaperRecord":
        """Read a file that `write` wrote. Raises ValueError if it holds something else."""
        try:
            fields = json.loads(path.read_text(encoding="utf-8"))
            trials = [Trial(**trial) for trial in fields.pop("trials")]
            return cls(origin=fields.pop("made"), trials=trials, **fields)
        except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path} holds no record of an experiment: run `hof-model paper NAME`") from error


def rounded(values: npt.ArrayLike) -> list[float | None]:
    """Return values as a record keeps them: DIGITS digits, None for NaN."""
    return [None if np.isnan(value) else round(value, DIGITS) for value in np.asarray(values, np.float64).tolist()]

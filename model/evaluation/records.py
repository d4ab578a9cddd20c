"""Raw metrics of an evaluation as a small JSON file: how a trained method that is not shipped enters RESULTS.md."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from model.evaluation.evaluate import Evaluation
from service.files import whole_file

DIGITS: Final = 5


@dataclass(frozen=True)
class Decoder:
    """What turns canonical points into the object: its parameters and layers, and the milliseconds that
    10,000 points take on one core."""

    parameters: int
    layers: int
    ms: float


@dataclass(frozen=True)
class Record:
    """Everything that one evaluation leaves behind.

    method : the name in the tables.
    decoder : None where there is none (references, ceilings).
    made : where the figures come from: config, seed, steps, minutes, commit, machine, date.
    ids : the objects, in manifest order; every figure has one value for each.
    """

    method: str
    split: str
    decoder: Decoder | None
    made: dict[str, Any]
    ids: tuple[str, ...]
    evaluations: tuple[Evaluation, ...]

    def write(self, path: Path) -> None:
        """Write as JSON, numbers rounded to DIGITS, whole or not at all."""
        fields = {
            "method": self.method,
            "split": self.split,
            "decoder": self.decoder and asdict(self.decoder),
            "made": self.made,
            "ids": self.ids,
            "evaluations": [
                {
                    "method": found.method,
                    "condition": found.condition,
                    "n": found.n,
                    **{name: [round(value, DIGITS) for value in found.column(name).tolist()] for name in found.figures},
                }
                for found in self.evaluations
            ],
        }
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write((_lines(fields) + "\n").encode())

    @classmethod
    def read(cls, path: Path) -> "Record":
        """Inverse of `write`. Raises ValueError for a file that is no record."""
        try:
            fields = json.loads(path.read_text(encoding="utf-8"))
            evaluations = [
                Evaluation(
                    found.pop("method"),
                    condition=found.pop("condition"),
                    n=found.pop("n"),
                    figures={name: np.array(values) for name, values in found.items()},
                )
                for found in fields.pop("evaluations")
            ]
            decoder = fields.pop("decoder")
            ids = tuple(fields.pop("ids"))
            return cls(**fields, decoder=decoder and Decoder(**decoder), ids=ids, evaluations=tuple(evaluations))
        except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path} holds no raw metrics; write it with `hof-model evaluate -o`") from error


def _lines(fields: dict[str, Any]) -> str:
    """JSON with one line per field and per evaluation, so that a change reads well in a diff."""
    rows = []
    for key, value in fields.items():
        if key == "evaluations":
            text = "[\n  " + ",\n  ".join(json.dumps(found) for found in value) + "\n ]"
        else:
            text = json.dumps(value, ensure_ascii=False)
        rows.append(f' "{key}": {text}')
    return "{\n" + ",\n".join(rows) + "\n}"

"""Raw metrics of an evaluation as a small JSON file, from which RESULTS.md is written."""

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
    """Size and speed of the function from canonical points to the object.

    ms : milliseconds for 10,000 points on one core.
    """

    parameters: int
    layers: int
    ms: float


@dataclass(frozen=True)
class Record:
    """Measurements of one method on a split.

    method : the name in the tables.
    decoder : None for references and ceilings.
    origin : where the figures come from: config, seed, steps, minutes, commit, machine, date. The file's key is `made`.
    ids : the objects, in manifest order; every figure has one value per object.
    """

    method: str
    split: str
    decoder: Decoder | None
    origin: dict[str, Any]
    ids: tuple[str, ...]
    evaluations: tuple[Evaluation, ...]

    def write(self, path: Path) -> None:
        """Write as JSON, numbers rounded to DIGITS, whole or not at all."""
        fields = {
            "method": self.method,
            "split": self.split,
            "decoder": self.decoder and asdict(self.decoder),
            "made": self.origin,
            "ids": self.ids,
            "evaluations": [
                {
                    "method": each.method,
                    "condition": each.condition,
                    "n": each.n,
                    **{name: [round(value, DIGITS) for value in each.column(name).tolist()] for name in each.figures},
                }
                for each in self.evaluations
            ],
        }
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write((_lines(fields) + "\n").encode())

    @classmethod
    def read(cls, path: Path) -> "Record":
        """Read a file that `write` wrote.

        Raises
        ------
        ValueError : the file holds no record.
        """
        try:
            fields = json.loads(path.read_text(encoding="utf-8"))
            evaluations = [
                Evaluation(
                    each.pop("method"),
                    condition=each.pop("condition"),
                    n=each.pop("n"),
                    figures={name: np.array(values) for name, values in each.items()},
                )
                for each in fields.pop("evaluations")
            ]
            decoder = fields.pop("decoder")
            ids = tuple(fields.pop("ids"))
            origin = fields.pop("made")
            decoder = decoder and Decoder(**decoder)
            return cls(**fields, decoder=decoder, origin=origin, ids=ids, evaluations=tuple(evaluations))
        except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path} holds no raw metrics; write it with `hof-model evaluate -o`") from error


def _lines(fields: dict[str, Any]) -> str:
    """Format as JSON with one line per field and per evaluation, so that diffs are readable."""
    rows = []
    for key, value in fields.items():
        if key == "evaluations":
            text = "[\n  " + ",\n  ".join(json.dumps(each) for each in value) + "\n ]"
        else:
            text = json.dumps(value, ensure_ascii=False)
        rows.append(f' "{key}": {text}')
    return "{\n" + ",\n".join(rows) + "\n}"

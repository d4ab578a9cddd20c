"""Raw metrics survive the file, which stays small."""

from pathlib import Path

import numpy as np
import pytest

from model.evaluation.evaluate import Evaluation
from model.evaluation.records import Decoder, Record
from model.metrics import NAMES


def record(method: str = "deepsdf", objects: int = 78) -> Record:
    rng = np.random.default_rng(0)
    figures = {name: rng.random(objects) * 10 for name in NAMES}
    origin = {"seed": 3, "commit": "abc", "training": {"steps": 5, "minutes": 0.1, "config": {"k": 2}}}
    ids = tuple(f"set/object{index}" for index in range(objects))
    return Record(method, "test", Decoder(7_171, 2, 1.25), origin, ids, (Evaluation(method, figures, "gray", 500),))


def test_record_written_reads_back_to_five_digits(tmp_path: Path) -> None:
    written = record()
    written.write(tmp_path / "results" / "deepsdf.json")
    copy = Record.read(tmp_path / "results" / "deepsdf.json")
    assert (copy.method, copy.split, copy.decoder, copy.origin, copy.ids) == (
        written.method,
        written.split,
        written.decoder,
        written.origin,
        written.ids,
    )
    (ours,), (theirs,) = written.evaluations, copy.evaluations
    assert (theirs.method, theirs.condition, theirs.n) == ("deepsdf", "gray", 500)
    for name in NAMES:
        assert theirs.column(name) == pytest.approx(ours.column(name), abs=5.1e-6)
    assert (tmp_path / "results" / "deepsdf.json").stat().st_size < 78 * (len(NAMES) * 9 + 25) + 500


@pytest.mark.parametrize("text", ["{}", "[]", "not JSON", '{"method": "x", "evaluations": [{}]}'])
def test_record_other_file_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(ValueError, match="no raw metrics"):
        Record.read(tmp_path / "x.json")

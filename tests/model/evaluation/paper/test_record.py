"""Records of experiments: written and read back."""

from pathlib import Path

import numpy as np
import pytest

from model.evaluation.paper.record import PaperRecord, Trial, rounded


def _record() -> PaperRecord:
    trials = [Trial("a", {"success": [0.5, None]}), Trial("b", {"success": [1.0, 0.25]})]
    return PaperRecord("paths", {"cells": 32}, {"seed": 0, "commit": "x"}, ["é", "2"], ["chair", "other"], trials)


def test_record_written_reads_back_equal(tmp_path: Path) -> None:
    _record().write(tmp_path / "paper" / "paths.json")
    assert PaperRecord.read(tmp_path / "paper" / "paths.json") == _record()


def test_record_of_another_kind_is_refused(tmp_path: Path) -> None:
    for text in ("{", "[]", "{}", '{"trials": [{}], "made": {}}'):
        (tmp_path / "x.json").write_text(text)
        with pytest.raises(ValueError, match="holds no record"):
            PaperRecord.read(tmp_path / "x.json")


def test_trial_column_has_nan_where_there_is_no_figure() -> None:
    np.testing.assert_array_equal(_record().trial("a").column("success"), [0.5, np.nan])
    assert rounded([0.123456789, np.nan]) == [0.12346, None]

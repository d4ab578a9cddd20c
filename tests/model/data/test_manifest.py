"""Splits, and reading a manifest."""

from pathlib import Path

import pytest

from model.data.manifest import Manifest, assign_splits


def test_assign_splits_by_seed_gives_disjoint_splits_of_the_right_sizes() -> None:
    ids = [f"object {index}" for index in range(200)]
    splits = assign_splits(ids, seed=3)
    sizes = {split: list(splits.values()).count(split) for split in ("train", "val", "test")}
    assert sizes == {"train": 160, "val": 20, "test": 20}
    assert splits == assign_splits(ids[::-1], seed=3)
    assert splits != assign_splits(ids, seed=4)


def test_assign_splits_fixed_ids_keep_their_split() -> None:
    before = assign_splits([f"object {index}" for index in range(100)], seed=0)
    splits = assign_splits([f"object {index}" for index in range(3, 150)], seed=0, fixed=before)
    assert {id_: split for id_, split in splits.items() if id_ in before} == {
        id_: split for id_, split in before.items() if id_ in splits
    }
    fresh = [split for id_, split in splits.items() if id_ not in before]
    assert {split: fresh.count(split) for split in ("train", "val", "test")} == {"train": 40, "val": 5, "test": 5}


def test_manifest_missing_names_the_command_to_run(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="hof-model data build"):
        Manifest.read(tmp_path)

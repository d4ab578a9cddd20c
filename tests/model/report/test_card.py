"""The license line of a model card."""

import pytest

from model.data.manifest import Entry, Manifest
from model.data.sources.sweethome3d import frozen_split
from model.report.card import LICENSE, license_of


def _manifest(*objects: tuple[str, str, str]) -> Manifest:
    """Return a data set of training objects: id, source, license."""
    entries = tuple(
        Entry(id_, id_, source, "chair", "someone", license_, "0", f"objects/{id_}.npz", "train")
        for id_, source, license_ in objects
    )
    return Manifest(0, entries, {}, {})


def test_license_of_the_frozen_split_is_that_of_the_shipped_models() -> None:
    id_ = next(id_ for id_, split in frozen_split().items() if split == "train")
    assert license_of(_manifest((id_, "Scopia", "Creative Commons Attribution 3.0 Unported license"))) == LICENSE


def test_license_of_open_sources_names_each_with_its_license() -> None:
    manifest = _manifest(
        ("a", "kenney", "CC0"), ("b", "ycb", "CC-BY-4.0"), ("c", "ycb", "CC-BY-4.0"), ("d", "drake", "BSD-2-Clause")
    )
    assert license_of(manifest) == (
        "Apache-2.0; trained on meshes with attribution in NOTICE: drake (BSD-2-Clause), kenney (CC0), ycb (CC-BY-4.0)"
    )


def test_license_of_pieces_of_meshes_is_named_too() -> None:
    piece = Entry("p", "p", "infinigen", "chair", "someone", "BSD-3-Clause", "0", "made/p.npz", "train")
    assert license_of(_manifest(("a", "kenney", "CC0")), [piece]) == (
        "Apache-2.0; trained on meshes with attribution in NOTICE: infinigen (BSD-3-Clause), kenney (CC0)"
    )


@pytest.mark.parametrize(
    "license_", ["SCEA", "CC-BY 4.0/LicenseRef-LegalMark-Khronos", "LicenseRef-CC-BY-TM/LicenseRef-LegalMark-Cesium"]
)
def test_license_of_a_source_that_limits_the_use_of_its_marks_alone_is_open(license_: str) -> None:
    expected = f"Apache-2.0; trained on meshes with attribution in NOTICE: khronos ({license_})"
    assert license_of(_manifest(("a", "khronos", license_))) == expected


@pytest.mark.parametrize(
    "license_",
    [
        "unknown",
        "LicenseRef-3DRT-Testing",
        "GPL-2",
        "CC-BY-NC-4.0",
        "CC BY-SA 3.0",
        "CC-BY-NC 4.0/LicenseRef-LegalMark-Khronos",
        "Creative Commons Attribution-NonCommercial 4.0",
    ],
)
def test_license_of_a_source_that_may_forbid_it_is_not_settled(license_: str) -> None:
    manifest = _manifest(("a", "polyhaven", "CC0"), ("b", "mine", license_))
    assert license_of(manifest) == (
        f"not settled: read the terms of mine ({license_}) before you share the file; other meshes: polyhaven (CC0)"
    )

"""Classes by name: the pitfalls of real catalog names."""

import pytest

from model.data.manifest import Entry
from model.evaluation.classes import class_of


@pytest.mark.parametrize(
    ("name", "category", "expected"),
    [
        ("Chair with cushion", "Living room", "chair"),
        ("Rattan armchair", "Exterior", "chair"),
        ("Bar stool", "Living room", "chair"),
        ("Wheelchair", "Miscellaneous", "other"),
        ("Seat Leon", "Vehicles", "vehicle"),
        ("Desk", "Office", "table"),
        ("Desk lamp", "Lights", "lamp"),
        ("Table fan", "Miscellaneous", "other"),
        ("Table tennis", "Miscellaneous", "table"),
        ("Table tennis bat", "Miscellaneous", "other"),
        ("Tablet", "Miscellaneous", "other"),
        ("Bedside table", "Bedroom", "cabinet"),
        ("Bunk bed", "Bedroom", "bed"),
        ("Futon couch", "Living room", "sofa"),
        ("Sofa 2 seats", "Living room", "sofa"),
        ("Opened convertible sofa BZ", "Bedroom", "bed"),
        ("Classic lamppost", "Lights", "lamp"),
        ("Flashlight", "Lights", "other"),
        ("Television cabinet", "Living room", "cabinet"),
        ("Chest freezer", "Kitchen", "appliance"),
        ("Island", "Kitchen", "cabinet"),
        ("Island bath", "Bathroom", "sanitary"),
        ("Abdominal bench", "Miscellaneous", "other"),
        ("Wood bank", "Exterior", "bench"),
        ("Glass table", "Living room", "table"),
        ("Glass door", "Doors and windows", "door or window"),
        ("Glass", "Kitchen", "tableware"),
        ("Glasses", "Miscellaneous", "other"),
        ("Medicine bottle", "Bathroom", "other"),
        ("Plant box", "Exterior", "other"),
        ("Siamese cat", "Characters", "figure"),
    ],
)
def test_class_of_catalog_name_returns_its_class(name: str, category: str, expected: str) -> None:
    assert class_of(Entry("", name, "", category, "", "", "", "", "test")) == expected

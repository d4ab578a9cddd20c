"""Classes of objects, by rules on their English names: catalogs sort by room, not by kind."""

import re
from typing import Final

from model.data.manifest import Entry
from model.data.shapenet.layouts import LAYOUTS

EVERYDAY: Final = ("chair", "table", "sofa", "bed", "lamp", "cabinet")
OTHER: Final = "other"

# The first rule whose words occur in the name wins, unless one of its excluded words occurs too.
RULES: Final[tuple[tuple[str, str, str], ...]] = (
    # class, words, excluded words
    ("lamp", r"\w*lamp\w*|lights?|spotlight|japanese lantern|fluorescent", ""),
    ("bed", r"beds?|crib|futon|opened convertible sofa", "couch"),
    ("sofa", "sofa|couch", ""),
    ("bench", "bench|bank", "abdominal"),
    ("cabinet", r"\w*cabinet|cupboard|wardrobe|dresser|chest|locker|bedside table|changing table|tv stand", "freezer"),
    ("cabinet", "vanity|island|contemporary living room", "bath|extension"),
    ("chair", r"\w*chair|stool|class seat|lounge", "wheelchair"),
    ("shelf", "bookcase|shelves", ""),
    ("table", "tables?|desk|workbench|island extension", "fan|bat"),
    ("sanitary", "toilets? unit|urinal|bidet|bath|bathtub|jacuzzi|washbasin|basin|lavatory|sink", ""),
    ("appliance", "oven|stove|cooker|cooktop|fridge|refrigerator|freezer|microwave|washing machine|hood", ""),
    ("appliance", "radiator|boiler|water heater|air conditioning|furnace|toaster|blender|mixer", ""),
    (
        "plant",
        r"plant|tree|ficus|bamboo|cactus|orchids|tulips|flowers|lily|yucca|spathiphyllum|bonsai|hedge|bush",
        "box",
    ),
    (
        "tableware",
        "cup|mug|glass|glasses and cutlery|bowl|plate|bottle|fork|knife|spoon|teapot|jar|tray",
        "door|table|medicine",
    ),
    ("vehicle", "motorbike", ""),
    ("plant", "acacia|pine|poplar|cypress|beech|maple|peach blossom", ""),
)
_CATEGORIES: Final = {"Characters": "figure", "Vehicles": "vehicle", "Doors and windows": "door or window"}


def class_of(entry: Entry) -> str:
    """Return the class of an object: ShapeNet's, one of EVERYDAY, another class of RULES, or OTHER."""
    if entry.source in LAYOUTS:
        return entry.category
    if entry.category in _CATEGORIES:
        return _CATEGORIES[entry.category]
    name = entry.name.lower()
    for label, words, excluded in RULES:
        if re.search(rf"\b({words})\b", name) and not (excluded and re.search(rf"\b({excluded})\b", name)):
            return label
    return OTHER

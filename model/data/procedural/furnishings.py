"""Random designs of cabinets, shelves, lamps, vessels, basins and appliances."""

import itertools
import math

import numpy as np

from model.data.procedural.primitives import Rng, Solid, box, cushion, lathe, ring, rod
from model.data.procedural.stands import fronts, legs


def cabinet(rng: Rng) -> list[Solid]:
    """Make a wardrobe, sideboard, chest of drawers or bedside table."""
    width, depth = rng.uniform(0.35, 2.2), rng.uniform(0.3, 0.65)
    height = rng.uniform(1.6, 2.3) if rng.random() < 0.35 else rng.uniform(0.4, 1.2)
    x, z = width / 2, depth / 2
    low = rng.uniform(0.05, 0.25) if rng.random() < 0.55 else 0.0
    feet = legs(rng, width, depth, low, rng.uniform(0.02, 0.04)) if low else []
    if rng.random() < 0.3:
        return [*feet, *_open_cabinet(rng, (x, z), (low, height))]
    solids = [*feet, box((-x, low, -z), (x, height, z), "wood")]
    if rng.random() < 0.4:
        over = rng.uniform(0.01, 0.05)
        solids.append(box((-x - over, height, -z), (x + over, height + 0.03, z + over), "top"))
    columns = max(1, round(width / rng.uniform(0.35, 0.7)))
    rows = max(1, round((height - low) / rng.uniform(0.2, 1.2)))
    split = rng.uniform(0.5, 0.9) if rng.random() < 0.35 else 1.0
    middle = low + split * (height - low)
    solids += fronts(rng, (-x, x), (low, middle), z, (columns, rows))
    if split < 1:
        solids += fronts(rng, (-x, x), (middle, height), z, (columns, 1))
    return solids


def _open_cabinet(rng: Rng, half: tuple[float, float], ends: tuple[float, float]) -> list[Solid]:
    """Make boards around cells, some with a door or a drawer: a TV stand, a dresser, a kitchen unit."""
    (x, z), (low, high), thick = half, ends, rng.uniform(0.015, 0.04)
    columns = max(1, round(2 * x / rng.uniform(0.35, 0.9)))
    rows = max(1, round((high - low) / rng.uniform(0.2, 0.5)))
    xs, ys = np.linspace(-x, x, columns + 1), np.linspace(low, high, rows + 1)
    solids = [box((at - thick / 2, low, -z), (at + thick / 2, high, z), "wood") for at in xs]
    solids += [box((-x, at - thick / 2, -z), (x, at + thick / 2, z), "wood") for at in ys]
    if rng.random() < 0.85:
        solids.append(box((-x, low, -z), (x, high, thick - z), "wood"))
    closed = rng.uniform(0, 0.8)
    for sides in itertools.pairwise(xs.tolist()):
        for cell in itertools.pairwise(ys.tolist()):
            if rng.random() < closed:
                solids += fronts(rng, sides, cell, z - thick, (1, 1))
    return solids


def shelf(rng: Rng) -> list[Solid]:
    """Make a bookcase or a rack, some with books."""
    width, depth, height = rng.uniform(0.4, 1.8), rng.uniform(0.2, 0.45), rng.uniform(0.7, 2.2)
    x, z, thick = width / 2, depth / 2, rng.uniform(0.015, 0.04)
    if rng.random() < 0.75:
        solids = [box((side - thick, 0, -z), (side + thick, height, z), "wood") for side in (-x, x)]
    else:
        solids = [rod((side, 0, end), (side, height, end), 0.02, "leg") for side in (-x, x) for end in (-z, z)]
    if rng.random() < 0.6:
        solids.append(box((-x, 0, -z), (x, height, thick - z), "wood"))
    levels = np.linspace(rng.uniform(0.02, 0.15), height - thick, int(rng.integers(3, 8)))
    books = rng.random() < 0.4
    for low, high in zip(levels, [*levels[1:], None], strict=True):
        solids.append(box((-x, low, -z), (x, low + thick, z), "wood"))
        if books and high is not None and rng.random() < 0.8:
            start, end = np.sort(rng.uniform(-x, x, 2))
            tall = rng.uniform(0.5, 0.9) * (high - low)
            solids.append(box((start, low + thick, thick - z), (end, low + tall, z * rng.uniform(0, 0.8)), "cover"))
    for at in np.linspace(-x, x, int(rng.integers(2, 5)))[1:-1]:
        solids.append(box((at - thick / 2, levels[0], -z), (at + thick / 2, height, z), "wood"))
    return solids


def lamp(rng: Rng) -> list[Solid]:
    """Make a floor, table, hanging or desk lamp, or spots on a rail."""
    kind, height = rng.random(), rng.uniform(0.3, 1.8)
    size = rng.uniform(0.08, 0.25) * (1 + height / 2)
    if kind < 0.1:
        return _rail(rng)
    if kind < 0.25:  # hangs
        return [
            rod((0, 0, 0), (0, height / 2, 0), 0.008, "leg"),
            *_shade(rng, size, 0.0),
            lathe([(0, height / 2), (0.06, height / 2), (0, height / 2 - 0.04)], "leg"),
        ]
    foot, thick = size * rng.uniform(0.5, 1.0), rng.uniform(0.01, 0.06)
    base = lathe([(0, 0), (foot, 0), (foot * rng.uniform(0.5, 1), thick), (0, thick)], "leg")
    if kind < 0.45:  # bends
        return [base, *_bent_arm(rng, height, size)]
    if kind < 0.65:  # a turned body
        body = size * rng.uniform(0.3, 0.9)
        tall = size * rng.uniform(1.0, 2.5)
        return [
            base,
            cushion((-body, thick, -body), (body, tall, body), "wood", rng.uniform(0.5, 1.3)),
            *_shade(rng, size * 1.2, tall + size * 0.5),
        ]
    return [base, rod((0, 0, 0), (0, height, 0), rng.uniform(0.008, 0.03), "leg"), *_shade(rng, size, height)]


def _bent_arm(rng: Rng, height: float, size: float) -> list[Solid]:
    """Make an arm of two bars or in a bow, with a shade at its end that points down."""
    reach = height * rng.uniform(0.3, 0.6)
    if rng.random() < 0.5:
        elbow = height * rng.uniform(0.5, 0.8)
        knots = [(0.0, 0.0, 0.0), (0.0, elbow, -reach / 3), (0.0, height, reach)]
    else:
        bow, turns = height * rng.uniform(0.15, 0.5), np.linspace(math.pi, rng.uniform(0, 0.3) * math.pi, 9)
        straight = height - bow
        arc = [(0.0, straight + bow * math.sin(turn), reach * (1 + math.cos(turn)) / 2) for turn in turns]
        knots = [(0.0, 0.0, 0.0), *arc]
    bars = [rod(start, end, 0.012, "leg") for start, end in itertools.pairwise(knots)]
    _, y, z = knots[-1]
    out = rng.uniform(-0.2, 0.6) * size
    return [*bars, rod((0, y, z), (0, y - size, z + out), (size * 0.25, size * 0.7), "shade", 24)]


def _rail(rng: Rng) -> list[Solid]:
    """Make spots that hang from a bar, each turned at random."""
    half, thick, size = rng.uniform(0.3, 0.9), rng.uniform(0.01, 0.03), rng.uniform(0.03, 0.08)
    solids = [box((-half, 0, -thick), (half, 1.5 * thick, thick), "leg")]
    for x in np.linspace(-half, half, int(rng.integers(3, 8)))[1:-1]:
        low, side, ahead = -rng.uniform(1.0, 2.5) * size, rng.uniform(-1, 1) * size, rng.uniform(-1, 2) * size
        tip = (x + side, low - 1.5 * size, ahead)
        solids.append(rod((x, 0, 0), (x, low, 0), thick / 2, "leg"))
        solids.append(rod((x, low, 0), tip, (size * 0.5, size), "shade", 16))
    return solids


def _shade(rng: Rng, size: float, y: float) -> list[Solid]:
    if rng.random() < 0.25:
        return [cushion((-size, y - size, -size), (size, y + size, size), "shade", 1.0)]
    top, half = size * rng.uniform(0.2, 1.0), size * rng.uniform(0.4, 1.0)
    return [lathe([(size, y - half), (top, y + half), (top - 0.005, y + half), (size - 0.005, y - half)], "shade")]


def vessel(rng: Rng) -> list[Solid]:
    """Make a hollow cup, bowl, plate, glass, vase or bottle, some with a handle and a saucer."""
    height = rng.uniform(0.15, 1.2)
    levels = np.linspace(0, height, 14)
    swing, phase = rng.uniform(0, 0.45), rng.uniform(0, 2 * math.pi)
    outer = 0.4 * (1 + swing * np.sin(phase + rng.uniform(1, 5) * levels / height))
    outer *= 1 + rng.uniform(-0.5, 0.6) * (1 - levels / height)
    if rng.random() < 0.25:  # a neck
        outer *= np.where(levels > height * rng.uniform(0.55, 0.8), rng.uniform(0.25, 0.5), 1)
    wall = rng.uniform(0.015, 0.05)
    inner = [(max(radius - wall, 0.01), max(y, wall)) for radius, y in zip(outer[::-1], levels[::-1], strict=True)]
    walls = [(0.0, 0.0), *zip(outer.tolist(), levels.tolist(), strict=True), *inner, (0.0, wall)]
    solids = [lathe(walls, "top")]
    if rng.random() < 0.45 and height > 0.4:
        middle, tall = len(levels) // 2, rng.uniform(0.22, 0.38) * height
        x = float(outer[middle]) * rng.choice([-1, 1])
        solids.append(ring(1, 0.12, (x, levels[middle], 0), (tall * rng.uniform(0.6, 1), tall, 0.25), "top"))
    if rng.random() < 0.3:  # filled
        solids.append(lathe([(0, 0.6 * height), (inner[4][0], inner[4][1]), (0, inner[4][1])], "cover"))
    if rng.random() < 0.3:
        wide = float(outer[0]) * rng.uniform(1.5, 2.4)
        rim = [(0, -0.05), (0.5 * wide, -0.05), (wide, 0.04), (wide - 0.02, 0.06), (0.5 * wide, -0.02), (0, -0.02)]
        solids.append(lathe(rim, "top"))
    return solids


def basin(rng: Rng) -> list[Solid]:
    """Make a washbasin, a bath or a toilet."""
    kind, white = rng.random(), "sheet"
    if kind < 0.4:
        size, depth = rng.uniform(0.22, 0.4), rng.uniform(0.1, 0.22)
        top = rng.uniform(0.75, 0.9)
        profile = [(0.02, top - depth), (0.7 * size, top - 0.6 * depth), (size, top), (0.9 * size, top)]
        bowl, material = lathe([*profile, (0.6 * size, top - 0.5 * depth), (0.02, top - 0.8 * depth)], white)
        bowl.apply_scale((rng.uniform(1, 1.6), 1, 1))
        tap = rod((0, top, -size), (0, top + 0.15, -size * 0.8), 0.02, "leg")
        foot = rng.uniform(0.06, 0.12)
        below = box((-foot, 0, -foot), (foot, top - 0.7 * depth, foot), white)
        return [(bowl, material), tap, *([below] if rng.random() < 0.7 else [])]
    if kind < 0.7:
        x, z, y, wall = rng.uniform(0.7, 0.95), rng.uniform(0.33, 0.5), rng.uniform(0.45, 0.65), 0.06
        sides = [box((-x, 0, z - wall), (x, y, z), white), box((-x, 0, -z), (x, y, wall - z), white)]
        ends = [box((x - wall, 0, -z), (x, y, z), white), box((-x, 0, -z), (wall - x, y, z), white)]
        return [*sides, *ends, box((-x, 0, -z), (x, 0.12, z), white)]
    x, seat, front = rng.uniform(0.16, 0.21), rng.uniform(0.36, 0.44), rng.uniform(0.28, 0.38)
    bowl_, _ = rod((0, 0, 0.02), (0, seat, 0.06), (x * 0.6, x), white, 24)
    bowl_.apply_scale((1, 1, front / x))
    lid = cushion((-x, seat, -0.2), (x, seat + 0.04, front), "top", 0.7)
    return [(bowl_, white), lid, box((-x, seat * rng.uniform(0, 1), -0.4), (x, rng.uniform(0.7, 0.85), -0.2), white)]


def appliance(rng: Rng) -> list[Solid]:
    """Make a cooker, fridge or washing machine, or a screen on a foot."""
    kind = rng.random()
    if kind < 0.3:
        return _screen(rng)
    x, z, height = rng.uniform(0.25, 0.45), rng.uniform(0.25, 0.35), rng.uniform(0.6, 1.0)
    if kind < 0.5:
        height *= 2
    solids = [box((-x, 0, -z), (x, height, z), "sheet")]
    if kind < 0.5:
        split = height * rng.uniform(0.3, 0.8)
        return [
            *solids,
            *fronts(rng, (-x, x), (0, split), z, (1, 1)),
            *fronts(rng, (-x, x), (split, height), z, (1, 1)),
        ]
    panel = height * 0.85
    solids += [
        rod((at, (panel + height) / 2, z), (at, (panel + height) / 2, z + 0.03), 0.025, "leg")
        for at in np.linspace(-x, x, 7)[1:-1]
    ]
    if kind < 0.75:
        middle = panel / 2
        door = rod((0, middle, z), (0, middle, z + 0.03), min(x, middle) * 0.7, "cover", 24)
        return [*solids, door]
    for at_x in (-x / 2, x / 2):
        for at_z in (-z / 2, z / 2):
            solids.append(
                lathe(
                    [(0, height), (0.09, height), (0.09, height + 0.015), (0, height + 0.015)], "leg", (at_x, 0, at_z)
                )
            )
    return [
        *solids,
        box((0.04 - x, 0.1, z), (x - 0.04, panel - 0.05, z + 0.02), "cover"),
        rod((0.06 - x, panel - 0.08, z + 0.05), (x - 0.06, panel - 0.08, z + 0.05), 0.012, "leg"),
    ]


def _screen(rng: Rng) -> list[Solid]:
    x, y, z = rng.uniform(0.25, 0.7), rng.uniform(0.2, 0.4), rng.uniform(0.015, 0.05)
    foot = rng.uniform(0.05, 0.15)
    frame = box((-x, foot, -z), (x, foot + 2 * y, z), "wood")
    face = box((0.03 - x, foot + 0.03, z), (x - 0.03, foot + 2 * y - 0.03, z + 0.003), "cover")
    below = box((-x * 0.4, 0, -0.12), (x * 0.4, 0.015, 0.12), "leg")
    return [frame, face, below, rod((0, 0, 0), (0, foot + 0.05, 0), 0.03, "leg")]

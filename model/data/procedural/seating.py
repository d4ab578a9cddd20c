"""Random designs of chairs, beds and tables. Each piece stands on the floor and faces +Z."""

import math

import numpy as np

from model.data.procedural.curved import arched_board, cloth
from model.data.procedural.primitives import Rng, Solid, box, cushion, lathe, lean, rod
from model.data.procedural.stands import fronts, legs, stand


def chair(rng: Rng) -> list[Solid]:
    """Make a chair, armchair of bars, office chair or bench."""
    width = rng.uniform(0.38, 0.62) * (rng.uniform(2, 3) if rng.random() < 0.12 else 1)
    depth, seat = rng.uniform(0.38, 0.6), rng.uniform(0.36, 0.52)
    solids = stand(rng, width, depth, seat)
    solids += _seat(rng, width, depth, seat)
    height = rng.uniform(0.3, 0.65)
    slope = rng.uniform(0, 0.35)
    solids += lean(_back(rng, width, depth, seat, height), slope, seat)
    if rng.random() < 0.35:
        solids += _bar_arms(rng, width, depth, seat)
    return solids


def _seat(rng: Rng, width: float, depth: float, top: float) -> list[Solid]:
    thick = rng.uniform(0.02, 0.12)
    low, high = (-width / 2, top - thick, -depth / 2), (width / 2, top, depth / 2)
    if rng.random() < 0.5:
        return [box(low, high, "wood")]
    return [cushion(low, high, "cloth", rng.uniform(0.15, 0.5))]


def _back(rng: Rng, width: float, depth: float, seat: float, height: float) -> list[Solid]:
    """Make a back: a panel, a padded panel, or posts with upright or cross bars."""
    x, z, top = width / 2 * rng.uniform(0.85, 1.0), -depth / 2, seat + height
    kind, thick = rng.random(), rng.uniform(0.02, 0.08)
    gap = rng.uniform(0, 0.5) * height if rng.random() < 0.4 else 0.0
    posts = [rod((side, seat - 0.05, z), (side, top, z), 0.02, "wood") for side in (-x, x)]
    if kind < 0.3:
        return [*posts, box((-x, seat + gap, z), (x, top, z + thick), "wood")]
    if kind < 0.6:
        return [*posts[: 2 * bool(gap)], cushion((-x, seat + gap, z), (x, top, z + 1.5 * thick), "cloth", 0.3)]
    across = [rod((-x, y, z), (x, y, z), 0.02, "wood") for y in np.linspace(top, seat, int(rng.integers(2, 6)))[:-1]]
    if kind < 0.8:
        return [*posts, *across]
    bars = [rod((at, seat, z), (at, top, z), 0.012, "wood") for at in np.linspace(-x, x, int(rng.integers(4, 9)))[1:-1]]
    return [*posts, across[0], *bars]


def _bar_arms(rng: Rng, width: float, depth: float, seat: float) -> list[Solid]:
    height, half = seat + rng.uniform(0.15, 0.28), rng.uniform(0.015, 0.04)
    solids = []
    for x in (-width / 2, width / 2):
        front = depth / 2 * rng.uniform(0.5, 1.0)
        solids.append(box((x - half, height - 0.03, -depth / 2), (x + half, height, front), "wood"))
        solids.append(rod((x, seat - 0.03, front * 0.9), (x, height, front * 0.9), 0.015, "wood"))
    return solids


def stool(rng: Rng) -> list[Solid]:
    """Make a seat without a back, low or at bar height."""
    width, seat = rng.uniform(0.3, 0.5), rng.uniform(0.3, 0.85)
    if rng.random() < 0.4:
        return [*stand(rng, width, width, seat), *_seat(rng, width, width, seat)]
    thick = rng.uniform(0.03, 0.12)
    top = lathe([(0, seat - thick), (width / 2, seat - thick), (width / 2, seat), (0, seat)], "cloth")
    return [*stand(rng, width * 0.8, width * 0.8, seat - thick), top]


def bed(rng: Rng) -> list[Solid]:
    """Make a bed for one or two, or a bunk bed."""
    width, length = rng.uniform(0.8, 2.0), rng.uniform(1.8, 2.2)
    solids = _berth(rng, width, length, 0.0)
    if width < 1.1 and rng.random() < 0.3:
        level = rng.uniform(1.0, 1.5)
        solids += _berth(rng, width, length, level)
        top = level + 0.5
        for x in (-width / 2, width / 2):
            for z in (-length / 2, length / 2):
                solids.append(rod((x, 0, z), (x, top, z), 0.035, "wood", 4))
        side = width / 2 * rng.choice([-1, 1])
        for step in np.arange(0.3, level, 0.28):
            solids.append(rod((side, step, 0.3), (side, step, 0.7), 0.02, "wood"))
    return solids


def _berth(rng: Rng, width: float, length: float, floor: float) -> list[Solid]:
    side, end = width / 2, length / 2
    low = floor + (rng.uniform(0.05, 0.3) if rng.random() < 0.7 else 0.0)
    frame = low + rng.uniform(0.08, 0.3)
    top = frame + rng.uniform(0.1, 0.3)
    solids = [box((-side, low, -end), (side, frame, end), "wood")]
    inset = rng.uniform(0, 0.05)
    solids.append(
        cushion(
            (inset - side, frame - 0.03, inset - end),
            (side - inset, top, end - inset),
            "sheet",
            rng.uniform(0.08, 0.25),
        )
    )
    if low > floor and not floor:
        solids += legs(rng, width, length, low, 0.04)
    if rng.random() < 0.6:
        start = rng.uniform(-0.5, 0.3) * end
        drop = rng.uniform(floor, frame) if rng.random() < 0.5 else rng.uniform(frame, top - 0.02)
        solids.append(cushion((-side - 0.02, drop, start), (side + 0.02, top + 0.03, end + 0.02), "cover", 0.12))
    count = 2 if width > 1.2 else 1
    for number in range(count if rng.random() < 0.85 else 0):
        middle, half = (number - (count - 1) / 2) * width / count, min(0.35, 0.42 * width / count)
        low_corner, high_corner = (middle - half, top - 0.03, 0.05 - end), (middle + half, top + 0.12, 0.45 - end)
        solids.append(cushion(low_corner, high_corner, "cushion", 0.5))
    if rng.random() < 0.85:
        solids += _board(rng, side, -end, floor, top + rng.uniform(0.1, 0.7))
    if rng.random() < 0.4:
        solids += _board(rng, side, end, floor, top + rng.uniform(-0.1, 0.35))
    return solids


def _board(rng: Rng, side: float, z: float, low: float, high: float) -> list[Solid]:
    """Make a headboard or footboard: a flat, arched or padded panel, or posts with bars."""
    thick = rng.uniform(0.03, 0.1) * math.copysign(1, z)
    near, far = sorted((z, z + thick))
    kind = rng.random()
    if kind < 0.25:
        return [box((-side, low, near), (side, high, far), "wood")]
    if kind < 0.55:
        return arched_board(rng, side, z, low, high, abs(thick))
    if kind < 0.7:
        return [cushion((-side, low, near), (side, high, far + 0.05), "cloth", 0.2)]
    solids = [rod((x, low, z), (x, high, z), 0.03, "wood", 4) for x in (-side, side)]
    solids += [rod((-side, y, z), (side, y, z), 0.025, "wood", 4) for y in (high, (low + high) / 2)]
    for x in np.linspace(-side, side, int(rng.integers(4, 12)))[1:-1]:
        solids.append(rod((x, (low + high) / 2, z), (x, high, z), 0.015, "wood"))
    return solids


def crib(rng: Rng) -> list[Solid]:
    """Make a baby's bed with bars all around."""
    side, end = rng.uniform(0.28, 0.42), rng.uniform(0.5, 0.72)
    low, high = rng.uniform(0.1, 0.35), rng.uniform(0.7, 1.1)
    solids = [cushion((-side, low, -end), (side, low + 0.14, end), "sheet", 0.15)]
    solids += [rod((x, 0, z), (x, high, z), 0.03, "wood", 4) for x in (-side, side) for z in (-end, end)]
    for y in (low, high):
        solids += [rod((x, y, -end), (x, y, end), 0.02, "wood", 4) for x in (-side, side)]
        solids += [rod((-side, y, z), (side, y, z), 0.02, "wood", 4) for z in (-end, end)]
    for x in (-side, side):
        for z in np.linspace(-end, end, int(rng.integers(6, 14)))[1:-1]:
            solids.append(rod((x, low, z), (x, high, z), 0.01, "wood"))
    return solids


def table(rng: Rng) -> list[Solid]:
    """Make a table, low or high, with a rectangular or round top; some under a cloth."""
    width, depth = rng.uniform(0.5, 2.0), rng.uniform(0.45, 1.1)
    height = rng.uniform(0.3, 0.55) if rng.random() < 0.4 else rng.uniform(0.65, 0.95)
    if rng.random() < 0.12:
        return cloth(rng, (width / 2, width / 2 if rng.random() < 0.5 else depth / 2), height)
    thick = rng.uniform(0.015, 0.08)
    if rng.random() < 0.35:
        radius = width / 2 if rng.random() < 0.5 else depth / 2
        width = depth = radius * 1.3
        under = height - thick
        solids = [lathe([(0, under), (radius, under), (radius, height), (0, height)], "top")]
    else:
        solids = [box((-width / 2, height - thick, -depth / 2), (width / 2, height, depth / 2), "top")]
    solids += stand(rng, width, depth, height - thick)
    if rng.random() < 0.35:
        y, x, z = rng.uniform(0.15, 0.5) * height, width / 2 * 0.9, depth / 2 * 0.9
        solids.append(box((-x, y, -z), (x, y + 0.02, z), "top"))
    if rng.random() < 0.35:
        x, z, drop = width / 2 * 0.92, depth / 2 * 0.92, rng.uniform(0.04, 0.14)
        solids.append(box((-x, height - thick - drop, -z), (x, height - thick, z), "wood"))
    return solids


def desk(rng: Rng) -> list[Solid]:
    """Make a writing table with drawers on one or both sides."""
    width, depth, height = rng.uniform(1.0, 1.9), rng.uniform(0.5, 0.9), rng.uniform(0.68, 0.8)
    x, z, block = width / 2, depth / 2, rng.uniform(0.3, 0.5)
    solids = [box((-x, height - 0.04, -z), (x, height, z), "top")]
    both, side = rng.random() < 0.4, rng.choice([-1, 1])
    for end in (-1, 1):
        if both or end == side:
            left, right = sorted((end * x, end * (x - block)))
            low = 0.0 if rng.random() < 0.5 else rng.uniform(0.05, 0.4)
            solids.append(box((left, low, -z), (right, height - 0.04, z - 0.02), "wood"))
            solids += fronts(rng, (left, right), (low, height - 0.04), z - 0.02, (1, int(rng.integers(2, 5))))
        foot = end * x * 0.96
        if rng.random() < 0.5:
            solids.append(box((foot - 0.02, 0, -z), (foot + 0.02, height - 0.04, z), "wood"))
        else:
            solids += [
                rod((foot, 0, near), (foot, height - 0.04, near), 0.025, "wood", 4) for near in (-z * 0.92, z * 0.92)
            ]
    return solids

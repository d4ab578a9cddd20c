"""Legs and stands of furniture, and fronts of drawers and doors."""

import itertools
import math

import numpy as np

from model.data.procedural.primitives import Rng, Solid, box, lathe, rod


def legs(rng: Rng, width: float, depth: float, height: float, radius: float) -> list[Solid]:
    """Make four legs below a box: round or square, tapering, some splayed."""
    sides = 4 if rng.random() < 0.5 else 12
    foot = radius * rng.uniform(0.4, 1.0)
    inset, splay = rng.uniform(0.8, 0.96), rng.uniform(0.9, 1.15)
    solids = []
    for x in (-width / 2 * inset, width / 2 * inset):
        for z in (-depth / 2 * inset, depth / 2 * inset):
            solids.append(rod((x * splay, 0, z * splay), (x, height, z), (foot, radius), "leg", sides))
    return solids


def stand(rng: Rng, width: float, depth: float, height: float) -> list[Solid]:
    """Make the stand of a seat or table top: legs with or without bars, a pedestal, a star on castors, or runners."""
    kind, radius = rng.random(), rng.uniform(0.012, 0.045)
    if kind < 0.6:
        solids = legs(rng, width, depth, height, radius)
        if rng.random() < 0.35:
            y, x, z = rng.uniform(0.15, 0.6) * height, width / 2 * 0.9, depth / 2 * 0.9
            solids += [rod((side, y, -z), (side, y, z), radius / 2, "leg") for side in (-x, x)]
            solids += [rod((-x, y, side), (x, y, side), radius / 2, "leg") for side in (-z, z)]
        return solids
    if kind < 0.72:
        foot, thick = min(width, depth) * rng.uniform(0.25, 0.48), rng.uniform(0.01, 0.05)
        pole = rng.uniform(0.02, 0.07)
        profile = [(0, 0), (foot, 0), (foot, thick), (pole, 2 * thick), (pole, height), (0, height)]
        return [lathe(profile, "leg")]
    if kind < 0.84:
        reach, hub, count = min(width, depth) * rng.uniform(0.45, 0.6), rng.uniform(0.06, 0.12), int(rng.integers(3, 6))
        solids = [rod((0, hub, 0), (0, height, 0), 0.03, "leg")]
        for angle in np.arange(count) * 2 * math.pi / count + rng.uniform(0, 1):
            x, z = reach * math.sin(angle), reach * math.cos(angle)
            solids.append(rod((0, hub, 0), (x, 0.03, z), 0.02, "leg"))
            solids.append(rod((x - 0.02, 0.03, z), (x + 0.02, 0.03, z), 0.03, "leg"))
        return solids
    x, z, solids = width / 2 * 0.95, depth / 2 * 0.95, []
    closed = rng.random() < 0.5
    for side in (-x, x):
        if rng.random() < 0.25:
            solids.append(box((side - radius, 0, -z), (side + radius, height, z), "leg"))
            continue
        solids.append(rod((side, radius, -z), (side, radius, z), radius, "leg"))
        solids.append(rod((side, 0, z), (side, height, z), radius, "leg"))
        if closed:
            solids.append(rod((side, 0, -z), (side, height, -z), radius, "leg"))
    return solids


def fronts(
    rng: Rng, sides: tuple[float, float], ends: tuple[float, float], z: float, cells: tuple[int, int]
) -> list[Solid]:
    """Make drawers or doors, columns by rows, on the front of a box at depth `z`, with knobs, bars or neither."""
    gap, proud = 0.008, rng.uniform(0.005, 0.025)
    handle, across = rng.random(), rng.random() < 0.5
    xs, ys = np.linspace(*sides, cells[0] + 1), np.linspace(*ends, cells[1] + 1)
    solids = []
    for column, (left, right) in enumerate(itertools.pairwise(xs)):
        for low, high in itertools.pairwise(ys):
            solids.append(box((left + gap, low + gap, z), (right - gap, high - gap, z + proud), "front"))
            x, y, out = (left + right) / 2, (low + high) / 2, z + proud + 0.025
            if high - low > right - left:  # a door: its handle is at the edge that opens
                x = (right if column % 2 == 0 else left) + (0.06 if column % 2 else -0.06)
            if handle < 0.4:
                solids.append(rod((x, y, z), (x, y, out), 0.015, "leg"))
            elif handle < 0.8:
                reach = (min(0.12, (right - left) / 3), 0) if across else (0, min(0.12, (high - low) / 3))
                start, end = (x - reach[0], y - reach[1], out), (x + reach[0], y + reach[1], out)
                solids.append(rod(start, end, 0.008, "leg"))
    return solids

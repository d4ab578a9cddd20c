"""Random designs other than furniture: things assembled from any solids, plants, figures, doors."""

import math
from typing import Final

import numpy as np

from model.data.procedural.primitives import MATERIALS, Doubles, Rng, Solid, Triple, between, box, cushion, lathe, rod

COLORED: Final = tuple(material for material in MATERIALS if material != "sheet")  # a sheet is nearly always white


def thing(rng: Rng) -> list[Solid]:
    """Make a body with parts on top, in front and, mostly in pairs, beside it: a toy, tool or machine."""
    size = np.exp(rng.uniform(-1.2, 0.2, 3))
    low, high = -size / 2, size / 2
    solids = [_part(rng, low, high)]
    for _ in range(int(rng.integers(1, 6))):
        axis = int(rng.choice(3, p=(0.3, 0.45, 0.25)))
        half = (high - low) / 2 * rng.uniform(0.15, 0.95, 3)
        middle = rng.uniform(low + 0.7 * half, high - 0.7 * half)
        is_before = axis == 0 or rng.random() < 0.65
        middle[axis] = (high if is_before else low)[axis] + (1 if is_before else -1) * half[axis] * rng.uniform(0.3, 1)
        if axis and rng.random() < 0.7:
            middle[0] = 0
        look = int(rng.integers(2**31))  # the two of a pair look alike
        for sign in (1, -1) if middle[0] and rng.random() < 0.8 else (1,):
            at = middle * np.array([sign, 1, 1])
            solids.append(_part(np.random.default_rng(look), at - half, at + half))
        if axis == 1 and rng.random() < 0.4:  # the next parts go on top of this one
            low, high = middle - half, middle + half
    return solids


def _part(rng: Rng, low: Doubles, high: Doubles) -> Solid:
    """Make a solid that fills a box: a block, a rounded block, or a lathed solid along one axis."""
    kind, material = rng.random(), COLORED[rng.integers(len(COLORED))]
    start, end = _triple(low), _triple(high)
    if kind < 0.35:
        return box(start, end, material)
    if kind < 0.65:
        return cushion(start, end, material, rng.uniform(0.15, 1.0))
    levels = np.linspace(0, 1, 8)
    waist = 1 + rng.uniform(0, 0.5) * np.sin(rng.uniform(0, 6) + rng.uniform(1, 6) * levels)
    waist *= 1 - rng.uniform(0, 0.9) * levels if rng.random() < 0.3 else 1
    radii = waist if kind < 0.85 else np.ones_like(waist)
    mesh, _ = lathe([(0, 0), *zip(radii.tolist(), levels.tolist(), strict=True), (0, 1)], material)
    axis = int(rng.choice(3, p=(0.25, 0.5, 0.25)))
    vertices = np.roll(np.array(mesh.vertices), axis - 1, axis=1)
    span = np.ptp(vertices, axis=0)
    mesh.vertices = low + (vertices - vertices.min(axis=0)) / span * (high - low)
    if mesh.volume < 0:
        mesh.invert()
    return mesh, material


def _triple(numbers: Doubles) -> Triple:
    x, y, z = (float(number) for number in numbers)
    return x, y, z


def plant(rng: Rng) -> list[Solid]:
    """Make leaves or a crown on stems, with or without a pot."""
    radius, height = rng.uniform(0.1, 0.25), rng.uniform(0.12, 0.4)
    foot = radius * rng.uniform(0.6, 1.0)
    solids = [lathe([(0, 0), (foot, 0), (radius, height), (radius * 0.9, height), (0, height * 0.9)], "front")]
    if rng.random() < 0.35:
        return _crown(rng, height) if rng.random() < 0.3 else [*solids, *_crown(rng, height)]
    top = height + rng.uniform(0.05, 0.9)
    for _ in range(int(rng.integers(6, 30))):
        solids.append(_leaf(rng, height * 0.9, top))
    return solids


def _crown(rng: Rng, low: float) -> list[Solid]:
    """Make a trunk, and foliage in a ball, a cone or a few balls."""
    radius = rng.uniform(0.1, 0.35)
    middle = low + radius + rng.uniform(0.05, 0.6)
    solids = [rod((0, 0, 0), (0, middle, 0), rng.uniform(0.01, 0.04), "wood")]
    if rng.random() < 0.3:
        return [*solids, rod((0, middle - radius, 0), (0, middle + 2 * radius, 0), (radius, 0.02), "cover", 20)]
    for _ in range(int(rng.integers(1, 5))):
        x, y, z = rng.uniform(-0.6, 0.6, 3) * radius
        half = radius * rng.uniform(0.6, 1)
        low_corner = (x - half, middle + y - half, z - half)
        solids.append(cushion(low_corner, (x + half, middle + y + half, z + half), "cover", 1.0))
    return solids


def _leaf(rng: Rng, low: float, top: float) -> Solid:
    """Make a blade that rises from the middle and bends outward."""
    angle, reach, wide = rng.uniform(0, 2 * math.pi), rng.uniform(0.05, 0.5), rng.uniform(0.01, 0.08)
    rise, fall = top - low, rng.uniform(0, 0.6)
    along = np.linspace(0, 1, 9)
    out, y = reach * along, low + rise * (along - fall * along**2)
    half = wide * np.sqrt(np.clip(along * (1.02 - along), 0, None)) * 2 + 0.004
    sides = np.array([-1.0, 0.0, 1.0])
    x = out[:, None] * math.sin(angle) + half[:, None] * sides * math.cos(angle)
    z = out[:, None] * math.cos(angle) - half[:, None] * sides * math.sin(angle)
    blade = np.stack([x, np.broadcast_to(y[:, None], x.shape), z], axis=-1)
    return between(blade, blade - np.array([0, 0.006, 0]), "cover")


def figure(rng: Rng) -> list[Solid]:
    """Make a person or an animal: a body with a head and limbs."""
    if rng.random() < 0.4:
        return _animal(rng)
    hip, waist, wide = rng.uniform(0.75, 0.95), rng.uniform(0.12, 0.2), rng.uniform(0.16, 0.25)
    neck = hip + rng.uniform(0.5, 0.62)
    solids = [
        cushion((-wide, hip - 0.08, -waist / 1.5), (wide, neck, waist / 1.5), "cloth", 0.7),
        cushion((-0.09, neck, -0.1), (0.09, neck + 0.26, 0.11), "top", 0.9),
    ]
    spread = rng.uniform(0.1, 0.9) if rng.random() < 0.8 else 1.6
    for side in (-1, 1):
        step = rng.uniform(-0.15, 0.15)
        foot = (side * rng.uniform(0.08, 0.22), 0.04, step)
        solids.append(rod((side * 0.09, hip, 0), foot, (0.05, 0.08), "cover"))
        solids.append(cushion((foot[0] - 0.05, 0, step - 0.08), (foot[0] + 0.05, 0.09, step + 0.17), "leg", 0.6))
        hand = (side * (wide + 0.6 * math.sin(spread)), neck - 0.05 - 0.6 * math.cos(spread), rng.uniform(-0.1, 0.25))
        solids.append(rod((side * wide, neck - 0.06, 0), hand, (0.055, 0.035), "cloth"))
    return solids


def _animal(rng: Rng) -> list[Solid]:
    height, long, wide = rng.uniform(0.15, 0.7), rng.uniform(0.25, 0.6), rng.uniform(0.1, 0.25)
    back = height + rng.uniform(0.2, 0.4)
    solids = [cushion((-wide, height, -long), (wide, back, long), "cloth", 0.8)]
    head, size = long + rng.uniform(0.0, 0.25), rng.uniform(0.09, 0.18)
    lift = back + rng.uniform(-0.1, 0.35)
    solids.append(rod((0, back - 0.1, long * 0.8), (0, lift, head), (wide * 0.7, size * 0.6), "cloth"))
    solids.append(
        cushion((-size * 0.7, lift - size, head - size), (size * 0.7, lift + size, head + 1.5 * size), "cloth", 0.9)
    )
    thick = rng.uniform(0.03, 0.07)
    for x in (-wide * 0.7, wide * 0.7):
        for z in (-long * 0.8, long * 0.7):
            solids.append(rod((x, 0, z), (x, height + 0.1, z), thick, "cloth"))
    tail = rng.uniform(-0.2, 0.3)
    solids.append(rod((0, back - 0.08, -long * 0.9), (0, back + tail, -long - rng.uniform(0.1, 0.4)), 0.03, "cloth"))
    return solids


def opening(rng: Rng) -> list[Solid]:
    """Make a door or a window: a frame, with a leaf or panes."""
    x, top, deep = rng.uniform(0.35, 0.9), rng.uniform(1.0, 2.2), rng.uniform(0.03, 0.1)
    bar = rng.uniform(0.03, 0.09)
    solids = [box((side - bar, 0, -deep), (side + bar, top, deep), "wood") for side in (-x, x)]
    solids += [box((-x, y - bar, -deep), (x, y + bar, deep), "wood") for y in (bar, top)]
    for at in np.linspace(-x, x, int(rng.integers(2, 5)))[1:-1]:
        solids.append(box((at - bar / 2, 0, -deep / 2), (at + bar / 2, top, deep / 2), "wood"))
    for at in np.linspace(0, top, int(rng.integers(2, 5)))[1:-1]:
        solids.append(box((-x, at - bar / 2, -deep / 2), (x, at + bar / 2, deep / 2), "wood"))
    if rng.random() < 0.7:
        solids.append(box((-x, bar, -0.01), (x, top, 0.01), "sheet" if rng.random() < 0.5 else "front"))
    return solids

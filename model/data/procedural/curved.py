"""Random designs with curved walls: tub and shell chairs, boards, cloths. `seating` has those with flat walls."""

import math

import numpy as np

from model.data.procedural.primitives import Doubles, Rng, Solid, between, cushion, lathe, signed_power
from model.data.procedural.stands import legs, stand


def tub(rng: Rng) -> list[Solid]:
    """Make an armchair, or a sofa for two or three, with a back that curves into its arms."""
    seats = int(rng.integers(1, 4)) if rng.random() < 0.35 else 1
    x, z = rng.uniform(0.33, 0.48) * (1 + 0.7 * (seats - 1)), rng.uniform(0.33, 0.48)
    low = rng.uniform(0.04, 0.18) if rng.random() < 0.7 else 0.0
    seat, thick = rng.uniform(0.36, 0.48), rng.uniform(0.05, 0.2)
    arm = seat + rng.uniform(0.05, 0.25)
    back = arm + rng.uniform(0.0, 0.45)
    reach, squareness = rng.uniform(0.5, 0.72) * math.pi, rng.uniform(0.5, 1.0)
    angles = np.linspace(-reach, reach, 41)
    rises = np.clip((1 + np.cos(angles)) / 2, 0, 1) ** rng.uniform(0.5, 3.0)
    tops = arm + (back - arm) * rises
    outer = _around(angles, tops, low, (x, z), squareness, rng.uniform(-0.05, 0.25))
    inner = outer * np.array([1 - thick / x, 1, 1 - thick / z])
    if rng.random() < 0.3:  # fluted like a shell
        flutes = rng.uniform(0.02, 0.08) * np.abs(np.cos(rng.integers(4, 10) * angles / 2))
        inner = inner * (1 - flutes[:, None] * np.array([1, 0, 1]))
    solids = [between(outer, inner, "cloth")]
    soft = "cushion" if rng.random() < 0.4 else "cloth"
    wide, front = x - thick * 0.6, z * rng.uniform(0.75, 1.05)
    solids.append(cushion((-wide, low, thick * 0.5 - z), (wide, seat - 0.12, front), "cloth", rng.uniform(0.1, 0.5)))
    each = 2 * wide / seats
    for number in range(seats):
        left = -wide + number * each
        low_corner, high_corner = (left, seat - 0.16, thick * 0.5 - z), (left + each, seat, front + 0.03)
        solids.append(cushion(low_corner, high_corner, soft, rng.uniform(0.2, 0.6)))
    if low:
        solids += legs(rng, 1.7 * x, 1.6 * z, low, rng.uniform(0.02, 0.04))
    return solids


def _around(
    angles: Doubles, tops: Doubles, low: float, radii: tuple[float, float], squareness: float, flare: float
) -> Doubles:
    """Return a wall around the vertical, open in front: (rows, angles, 3), from `low` to `tops`, flaring out."""
    heights = np.linspace(0, 1, 6)[:, None]
    y = low + heights * (tops - low)
    wider = 1 + flare * (y - low)
    x = radii[0] * signed_power(np.sin(angles), squareness)
    z = -radii[1] * signed_power(np.cos(angles), squareness)
    return np.stack([x * wider, y, z * wider], axis=-1)


def bucket(rng: Rng) -> list[Solid]:
    """Make a chair with seat and back in one shell."""
    width, depth, seat = rng.uniform(0.4, 0.75), rng.uniform(0.4, 0.6), rng.uniform(0.32, 0.5)
    height, lean, hollow = rng.uniform(0.25, 0.85), rng.uniform(0, 0.45), rng.uniform(0, 0.14)
    knots = np.array(
        [
            (depth / 2, seat),
            (-rng.uniform(0.4, 0.8) * depth, seat - rng.uniform(0, 0.08)),
            (-rng.uniform(0.4, 0.6) * depth, seat + 0.2 * height),
            (-depth / 2 - lean * height, seat + height),
        ]
    )
    along = np.linspace(0, 1, 18)[:, None]
    weights = np.hstack([(1 - along) ** 3, 3 * along * (1 - along) ** 2, 3 * along**2 * (1 - along), along**3])
    z, y = (weights @ knots).T
    normal = np.stack([-np.gradient(z), np.gradient(y)], axis=1)  # (y, z), toward the sitter
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.linspace(-1, 1, 15)
    narrow = rng.uniform(0, 0.6) * np.clip((along[:, 0] - rng.uniform(0.4, 0.8)) / 0.4, 0, 1) ** 2
    half = width / 2 * (1 - narrow)
    raised = hollow * across**2
    shell = np.stack(
        [half[:, None] * across, y[:, None] + normal[:, :1] * raised, z[:, None] + normal[:, 1:] * raised], axis=-1
    )
    thick = rng.uniform(0.012, 0.09)
    below = shell - thick * np.stack([np.zeros(len(normal)), *normal.T], axis=-1)[:, None]
    return [*stand(rng, width * 0.8, depth * 0.8, seat - thick), between(shell, below, "cloth")]


def arched_board(rng: Rng, side: float, z: float, low: float, high: float, thick: float) -> list[Solid]:
    """Make a headboard or a sofa's back outward from depth `z`, with a straight, arched, waved or stepped top."""
    across = np.linspace(-1, 1, 25)
    rise, kind = rng.uniform(0.1, 0.5) * (high - low) * 0.6, rng.random()
    if kind < 0.25:
        shape = np.ones(across.shape)
    elif kind < 0.6:
        shape = np.sqrt(1 - 0.98 * across**2)
    elif kind < 0.85:
        shape = 0.5 + 0.5 * np.cos(rng.choice([1, 2, 3]) * math.pi * across)
    else:
        shape = (np.abs(across) < rng.uniform(0.3, 0.8)).astype(float)
    tops = high - rise + rise * shape
    y = low + np.linspace(0, 1, 8)[:, None] * (tops - low)
    x = np.broadcast_to(side * across, y.shape)
    dent = rng.uniform(0, 0.03) * np.cos(rng.integers(4, 9) * math.pi * x / side) * np.cos(18 * y)  # buttons
    outward = math.copysign(1, z)
    near = np.stack([x, y, np.full_like(y, z) - outward * dent], axis=-1)
    far = np.stack([x, y, np.full_like(y, z + outward * thick)], axis=-1)
    return [between(near, far, "cloth" if rng.random() < 0.6 else "wood")]


def cloth(rng: Rng, radii: tuple[float, float], top: float) -> list[Solid]:
    """Make a round or square tablecloth that falls in folds to its hem."""
    hem = rng.uniform(0, 0.7) * top if rng.random() < 0.5 else rng.uniform(0, 0.1)
    square = rng.uniform(0.25, 0.5) if rng.random() < 0.4 else 1.0
    angles = np.linspace(-math.pi, math.pi, 73)
    down = np.linspace(0, 1, 8)[:, None]
    folds = rng.uniform(0, 0.07) * down * np.cos(rng.integers(6, 16) * angles + rng.uniform(0, 6))
    wide = 1 + rng.uniform(0, 0.25) * down + folds
    x = radii[0] * wide * signed_power(np.sin(angles), square)
    z = radii[1] * wide * signed_power(np.cos(angles), square)
    y = np.broadcast_to(top - down * (top - hem), x.shape)
    skirt = np.stack([x, y, z], axis=-1)
    cover, material = lathe([(0, top - 0.01), (1, top - 0.01), (1, top), (0, top)], "cloth")
    corners = np.array(cover.vertices)
    at = np.arctan2(corners[:, 0], corners[:, 2])
    flat = np.hypot(corners[:, 0], corners[:, 2])
    for column, (radius, wave) in zip((0, 2), zip(radii, (np.sin(at), np.cos(at)), strict=True), strict=True):
        corners[:, column] = flat * radius * signed_power(wave, square)
    cover.vertices = corners
    return [between(skirt, skirt * np.array([0.98, 1, 0.98]), "cloth"), (cover, material)]

"""Random designs of sofas and armchairs: a box, cushions, a back and arms of many kinds, some around a corner."""

from dataclasses import dataclass

import numpy as np
import trimesh

from model.data.procedural.curved import arched_board
from model.data.procedural.primitives import Rng, Solid, box, cushion, lean, rod
from model.data.procedural.stands import legs


@dataclass(frozen=True)
class _Plan:
    """Lengths of a sofa in meters.

    seats, each : number of seats, and the width of one.
    front : half of the depth.
    foot, base, seat, top : heights of the legs, of the box on them, of the cushions on the box, and of the back.
    back : thickness of the back.
    round_ : `roundness` of its cushions and soft arms.
    """

    seats: int
    each: float
    front: float
    foot: float
    base: float
    seat: float
    top: float
    back: float
    round_: float

    @property
    def inner(self) -> float:
        """Half of the width between the arms."""
        return self.seats * self.each / 2


def sofa(rng: Rng) -> list[Solid]:
    """Make an armchair or a sofa of up to four seats, some around a corner."""
    plan = _plan(rng)
    carrier = "wood" if rng.random() < 0.15 else "cloth"
    solids = [box((-plan.inner, plan.foot, -plan.front), (plan.inner, plan.base, plan.front), carrier)]
    solids += lean(_back(rng, plan), rng.uniform(0, 0.25), plan.seat)
    solids += _cushions(rng, plan, "cushion" if rng.random() < 0.4 else "cloth")
    arm = rng.uniform(0.1, 0.3) if rng.random() < 0.9 else 0.0
    if arm:
        solids += _arms(rng, plan, arm)
    if plan.foot:
        solids += legs(rng, 2 * (plan.inner + arm), 2 * plan.front, plan.foot, 0.03)
    if plan.seats > 1 and rng.random() < 0.35:
        solids += _corner(rng, plan)
    if rng.random() < 0.35:
        solids += _pillows(rng, plan)
    return solids


def _plan(rng: Rng) -> _Plan:
    foot = rng.uniform(0.03, 0.16) if rng.random() < 0.7 else 0.0
    return _Plan(
        seats=int(rng.choice(4, p=(0.35, 0.25, 0.25, 0.15))) + 1,
        each=rng.uniform(0.5, 0.8),
        front=rng.uniform(0.35, 0.5),
        foot=foot,
        base=foot + rng.uniform(0.05, 0.25),
        seat=rng.uniform(0.38, 0.5),
        top=rng.uniform(0.65, 1.05),
        back=rng.uniform(0.1, 0.3),
        round_=rng.uniform(0.15, 0.5),
    )


def _back(rng: Rng, plan: _Plan) -> list[Solid]:
    """Make a back: a cushion as long as the seat, some with a rolled top, or a board of any shape."""
    behind = plan.back - plan.front
    if rng.random() < 0.4:
        return arched_board(rng, plan.inner, behind, plan.foot, plan.top, plan.back)
    low, high = (-plan.inner, plan.foot, -plan.front), (plan.inner, plan.top, behind)
    solids = [cushion(low, high, "cloth", plan.round_)]
    if rng.random() < 0.2:
        radius = plan.back * rng.uniform(0.5, 0.8)
        y, z = plan.top - radius, -plan.front + plan.back / 2
        solids.append(rod((-plan.inner, y, z), (plan.inner, y, z), radius, "cloth", 20))
    return solids


def _cushions(rng: Rng, plan: _Plan, soft: str) -> list[Solid]:
    """Make seat cushions, one per seat or one for all, and sometimes cushions to lean on."""
    solids, behind = [], plan.back - plan.front
    leaning = rng.random() < 0.5
    thick, round_ = rng.uniform(0.1, 0.2), rng.uniform(0.1, 0.4)
    count = plan.seats if rng.random() < 0.8 else 1
    for number in range(count):
        wide = 2 * plan.inner / count
        left = -plan.inner + number * wide
        solids.append(cushion((left, plan.base, behind), (left + wide, plan.seat, plan.front * 1.02), soft, round_))
        if leaning:
            top = plan.seat + (plan.top - plan.seat) * rng.uniform(0.85, 1.15)
            pillow = cushion((left, plan.seat, behind), (left + wide, top, behind + thick), soft, plan.round_)
            solids += lean([pillow], 0.2, plan.seat)
    return solids


def _arms(rng: Rng, plan: _Plan, arm: float) -> list[Solid]:
    """Make two equal arms: boxes, cushions or wood, some rolled, some falling to the front."""
    top = plan.top if rng.random() < 0.15 else min(plan.top, plan.seat + rng.uniform(0.05, 0.25))
    inner, front = plan.inner, plan.front * rng.uniform(0.85, 1.0)
    kind, fall = rng.random(), rng.uniform(0, 0.3) if rng.random() < 0.4 else 0.0
    solids: list[Solid] = []
    for side in (-1, 1):
        near, far = sorted((side * inner, side * (inner + arm)))
        middle = (near + far) / 2
        if kind < 0.12:
            half = min(arm / 2, 0.04)
            solids.append(box((middle - half, top - 0.04, -front), (middle + half, top, front), "wood"))
            solids += [rod((middle, 0, z), (middle, top - 0.02, z), half * 0.8, "wood", 4) for z in (-front, front)]
        elif kind < 0.4:
            solids.append(box((near, plan.foot, -front), (far, top, front), "cloth"))
        else:
            solids.append(cushion((near, plan.foot, -front), (far, top, front), "cloth", plan.round_))
        if kind > 0.7:
            radius = arm * rng.uniform(0.5, 0.7)
            solids.append(
                rod((middle, top - radius / 2, -front), (middle, top - radius / 2, front), radius, "cloth", 20)
            )
    for mesh, _ in solids:
        corners = np.array(mesh.vertices)
        corners[:, 1] -= fall * np.maximum(corners[:, 2] + front, 0) * (corners[:, 1] > plan.seat)
        mesh.vertices = corners
    return solids


def _corner(rng: Rng, plan: _Plan) -> list[Solid]:
    """Make the corner of an L-shaped sofa: an end seat that reaches forward, some with a back beside it."""
    side, reach = float(rng.choice([-1, 1])), rng.uniform(0.4, 1.4)
    near, far = sorted((side * plan.inner, side * (plan.inner - plan.each)))
    end, wall = plan.front + reach, sorted((side * plan.inner, side * (plan.inner + plan.back)))
    solids = [
        box((near, plan.foot, -plan.front), (far, plan.base, end), "cloth"),
        cushion((near, plan.base, -plan.front), (far, plan.seat, end), "cloth", rng.uniform(0.1, 0.3)),
    ]
    if plan.foot:
        solids += [rod((x * 0.95, 0, end * 0.95), (x * 0.95, plan.foot, end * 0.95), 0.03, "leg") for x in (near, far)]
    if reach > 0.8:
        solids.append(cushion((wall[0], plan.foot, -plan.front), (wall[1], plan.top, end), "cloth", plan.round_))
    return solids


def _pillows(rng: Rng, plan: _Plan) -> list[Solid]:
    """Make one to four pillows against the back, each turned at random."""
    solids = []
    for x in rng.uniform(-0.85, 0.85, int(rng.integers(1, 5))) * plan.inner:
        half, thick = rng.uniform(0.15, 0.25), rng.uniform(0.1, 0.2)
        z = plan.back - plan.front + 0.12
        mesh, material = cushion((x - half, plan.seat, z), (x + half, plan.seat + 2 * half, z + thick), "cover", 0.5)
        middle = mesh.vertices.mean(axis=0)
        for angle, axis in ((rng.uniform(-0.5, 0.5), (0, 0, 1)), (-rng.uniform(0.1, 0.5), (1, 0, 0))):
            mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, axis, middle))
        solids.append((mesh, material))
    return solids

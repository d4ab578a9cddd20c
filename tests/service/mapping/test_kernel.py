"""The compiled kernel against NumPy, with every instruction set that the processor has."""

import numpy as np
import pytest

from service.mapping import compiled
from service.mapping.canonical import span
from service.mapping.compiled import Kernel
from service.mapping.folding import MARGIN, CompiledFold, Fold, NumpyFold
from service.mapping.spec import Array, MappingSpec, initial_theta
from tests.service.mapping.engines import built_kernel, instruction_sets, needs_kernel, weights

pytestmark = needs_kernel
BOX = np.ones(3)
EXACT = 2e-6  # of the largest value


@pytest.fixture(params=[pytest.param(number, id=name) for name, number in instruction_sets().items()])
def instructions(request: pytest.FixtureRequest) -> int:
    number: int = request.param
    return number


class OneSet(CompiledFold):
    """A fold, evaluated with one instruction set."""

    def __init__(self, fold: Fold, instructions: int) -> None:
        super().__init__(fold, built_kernel())
        self.instructions = instructions

    def map(self, x: Array) -> Array:
        y = np.full(x.shape, np.nan, np.float32)
        fold = self._fold
        arrays = (fold.origin, fold.per_unit, fold.grid, self._starts, self._units, fold.affine, y)
        self._kernel.map(x, *arrays, self.instructions)
        return y


def fold_of(width: int, grid: int, seed: int = 0) -> Fold:
    spec = MappingSpec("one layer", 3, (width,), 3)
    return Fold(spec, weights(spec, seed), -BOX, BOX, grid)


@pytest.mark.parametrize("width", [1, 7, 64, 65, 500])
@pytest.mark.parametrize("grid", [0, 1, 6])
@pytest.mark.parametrize("n", [1, 3, 16, 31, 97, 4_099])
def test_map_gives_the_values_of_numpy(width: int, grid: int, n: int, instructions: int) -> None:
    fold = fold_of(width, grid, seed=n)
    x = np.random.default_rng(n).uniform(-1.5, 1.5, (3, n)).astype(np.float32)  # most cells of a few points are empty
    expected = NumpyFold(fold).map(x.copy())
    np.testing.assert_allclose(OneSet(fold, instructions).map(x), expected, rtol=0, atol=EXACT * np.abs(expected).max())


def test_map_gives_a_point_the_same_bits_among_any_others(instructions: int) -> None:
    evaluate = OneSet(fold_of(300, 4), instructions)
    x = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 1_000)).astype(np.float32)
    whole = evaluate.map(x)
    for begin, end in ((0, 1), (17, 18), (3, 50), (500, 1_000)):
        part = evaluate.map(np.ascontiguousarray(x[:, begin:end]))
        assert part.tobytes() == np.ascontiguousarray(whole[:, begin:end]).tobytes()


@pytest.mark.parametrize("grid", [0, 4])
@pytest.mark.parametrize("bad", [np.nan, -np.nan, np.inf, -np.inf])
def test_map_keeps_nan_and_infinities(grid: int, bad: float, instructions: int) -> None:
    fold = fold_of(40, grid)
    x = np.random.default_rng(0).uniform(-1, 1, (3, 100)).astype(np.float32)
    finite = OneSet(fold, instructions).map(x)
    x[1, 33] = bad
    values = OneSet(fold, instructions).map(x)
    assert not np.isfinite(values[:, 33]).any()
    others = np.arange(100) != 33
    np.testing.assert_array_equal(values[:, others], finite[:, others])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_map_with_weights_that_are_not_finite_keeps_them(bad: float, instructions: int) -> None:
    spec = MappingSpec("one layer", 3, (40,), 3)
    theta = initial_theta(spec)
    theta[:3] = bad  # of one hidden unit
    with np.errstate(invalid="ignore"):
        values = OneSet(Fold(spec, theta, -BOX, BOX, 2), instructions).map(np.full((3, 5), 0.1, np.float32))
    assert not np.isfinite(values).any()


def test_map_of_no_points_gives_none(instructions: int) -> None:
    assert OneSet(fold_of(5, 2), instructions).map(np.empty((3, 0), np.float32)).shape == (3, 0)


@pytest.mark.parametrize(("seed", "low"), [(0, 0), (2**64 - 1, 2**62), (17, 2**63 - 4_096)])
def test_uniform_gives_the_bits_of_numpys_philox(seed: int, low: int, monkeypatch: pytest.MonkeyPatch) -> None:
    built_kernel()
    points = span("cube", seed, low, low + 4_096)
    monkeypatch.setattr(compiled, "load", lambda: None)
    assert span("cube", seed, low, low + 4_096).tobytes() == points.tobytes()


@pytest.mark.parametrize("width", [1, 31, 32, 500])
@pytest.mark.parametrize("grid", [1, 2, 5])
def test_cut_finds_the_cells_of_numpy(width: int, grid: int, instructions: int) -> None:
    expected, fold, step = fold_of(width, grid), fold_of(width, grid), 2 * BOX / grid
    fold.affine[:], fold.crossing[:] = np.nan, False
    sides = (-BOX).astype(np.float32), step.astype(np.float32), ((0.5 + MARGIN) * step).astype(np.float32)
    second = np.ascontiguousarray(fold.second)
    built_kernel().cut(fold.first, second, grid, *sides, fold.affine, fold.crossing, instructions)
    np.testing.assert_array_equal(fold.crossing[:-1], expected.crossing[:-1])
    assert not fold.crossing[-1].any()  # outside the box nothing changes
    assert np.isnan(fold.affine[-1]).all()
    bias = expected.affine[-1, :, 3]
    np.testing.assert_allclose(fold.affine[:-1, :, 3] + bias, expected.affine[:-1, :, 3], rtol=0, atol=1e-5)
    np.testing.assert_allclose(fold.affine[:-1, :, :3], expected.affine[:-1, :, :3], rtol=0, atol=1e-5)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_cut_of_weights_that_are_not_finite_leaves_the_unit_to_compute(bad: float) -> None:
    spec = MappingSpec("one layer", 3, (40,), 3)
    theta = initial_theta(spec)
    theta[:3] = bad  # of one hidden unit
    fold = Fold(spec, theta, -BOX, BOX, 2, built_kernel())
    assert fold.crossing[:, 0].all()
    assert np.isfinite(fold.affine).all()


def test_pack_writes_the_units_of_each_cell() -> None:
    rng = np.random.default_rng(0)
    crossing, units = rng.random((9, 20)) < 0.3, rng.random((20, 7), np.float32)
    crossing[4] = False
    starts, packed = np.empty(10, np.int64), np.empty((crossing.sum(), 7), np.float32)
    built_kernel().pack(crossing, units, starts, packed)
    np.testing.assert_array_equal(starts, [0, *crossing.sum(axis=1).cumsum()])
    np.testing.assert_array_equal(packed, np.concatenate([units[cell] for cell in crossing]))


def test_best_instruction_set_is_the_default() -> None:
    kernel: Kernel = built_kernel()
    fold = fold_of(100, 3)
    x = np.random.default_rng(0).uniform(-1, 1, (3, 50)).astype(np.float32)
    best = OneSet(fold, min(kernel.SETS.values())).map(x)
    assert CompiledFold(fold, kernel).map(x).tobytes() == best.tobytes()

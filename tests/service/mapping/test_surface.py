"""Surfaces of simple functions: closed, facing outward, in the right place."""

import numpy as np
import pytest
import trimesh

from service.mapping.sampler import SCALES, Sampler
from service.mapping.spec import Array, MappingSpec, initial_theta, power
from service.mapping.surface import RESOLUTIONS, SHELLS, Surface, icosphere, shells, surface_of

SPHERE = MappingSpec("six", input_dim=3, hidden=(6,), output_dim=3, k=2, domain="sphere")


def _linear(factors: tuple[float, float, float]) -> Array:
    """Return theta of x -> factors * x, by relu(x) - relu(-x)."""
    eye = np.eye(3, dtype=np.float32)
    first, second = (
        np.concatenate([eye, -eye]),
        np.concatenate([eye, -eye], axis=1) * np.array(factors, np.float32)[:, None],
    )
    return np.concatenate([first.ravel(), np.zeros(6), second.ravel(), np.zeros(3)], dtype=np.float32)


def _surface(spec: MappingSpec, theta: Array, resolution: int = 16, scale: float = 1.0) -> Surface:
    return surface_of(Sampler(spec, (theta,) * spec.k), resolution, scale)


def _solid(surface: Surface) -> trimesh.Trimesh:
    return trimesh.Trimesh(surface.vertices, surface.triangles, process=False)


@pytest.mark.parametrize("resolution", [1, 2, 5, 32])
def test_icosphere_of_any_resolution_is_closed_and_faces_outward(resolution: int) -> None:
    points, triangles = icosphere(resolution)
    assert (len(points), len(triangles)) == (10 * resolution**2 + 2, 20 * resolution**2)
    solid = trimesh.Trimesh(points, triangles, process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert 2.5 < solid.volume < 4 / 3 * np.pi
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-6)


def test_surface_of_identity_is_the_sphere_with_its_normals() -> None:
    surface = _surface(SPHERE, _linear((1, 1, 1)))
    solid = _solid(surface)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    np.testing.assert_allclose(np.linalg.norm(surface.vertices, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(surface.normals, surface.vertices, atol=0.02)


def test_surface_with_k_and_scale_applies_f_k_times_and_scales() -> None:
    extents = np.ptp(_surface(SPHERE, _linear((1, 0.5, 0.8)), scale=3).vertices, axis=0)
    np.testing.assert_allclose(extents, [6, 1.5, 3.84], rtol=0.02)


def test_surface_of_any_scale_has_unit_normals() -> None:
    small, large = (_surface(SPHERE, _linear((1, 0.5, 0.8)), scale=scale) for scale in SCALES)
    np.testing.assert_allclose(small.normals, large.normals, atol=1e-4)


@pytest.mark.parametrize("domain", SHELLS)
def test_shells_of_a_domain_are_closed_and_lie_in_it(domain: str) -> None:
    spec = MappingSpec("any", 4 if domain == "ball4" else 3, (8,), 3, domain=domain)  # type: ignore[arg-type]
    points, triangles = shells(spec.domain, 15)
    each = round(15 / SHELLS[spec.domain] ** 0.5)
    size = np.abs(points).max(axis=1) if domain == "cube" else np.linalg.norm(points, axis=1)
    assert size.max() <= 1 + 1e-6
    assert len(triangles) == SHELLS[spec.domain] * 20 * each**2
    assert len(np.unique(triangles)) == len(points) == SHELLS[spec.domain] * (10 * each**2 + 2)
    if spec.input_dim == 3:
        assert trimesh.Trimesh(points, triangles, process=False).is_watertight
    theta = initial_theta(spec)
    surface = _surface(spec, theta, 15)
    expected = power(spec, theta, points)
    distances = np.linalg.norm(surface.vertices[:20, None] - expected, axis=2).min(axis=1)
    assert distances.max() < 1e-5


def test_surface_of_a_torn_domain_is_not_joined() -> None:
    """Map x to x + 4 at the right of 0, within a hundredth of a unit: two half spheres, four apart."""
    spec = MappingSpec("eight", 3, (8,), 3, domain="sphere")
    (w, v) = (np.zeros((8, 3), np.float32), np.zeros((3, 8), np.float32))
    w[:3], w[3:6] = np.eye(3), -np.eye(3)
    v[:, :3], v[:, 3:6] = np.eye(3), -np.eye(3)
    w[6, 0] = w[7, 0] = 1
    b = np.zeros(8, np.float32)
    b[7] = -0.01
    v[0, 6], v[0, 7] = 400, -400
    theta = np.concatenate([w.ravel(), b, v.ravel(), np.zeros(3)], dtype=np.float32)
    solid = _solid(_surface(spec, theta, 32))
    x = solid.triangles[:, :, 0]
    assert np.ptp(x, axis=1).max() < 1
    assert (x.max() > 4, x.min() < -0.9) == (True, True)
    assert len(solid.faces) > 0.9 * 20 * 32**2


def test_surface_of_a_constant_function_has_unit_normals() -> None:
    surface = _surface(SPHERE, np.zeros(SPHERE.size, np.float32))
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-6)
    assert len(surface.triangles) > 0


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_surface_at_either_end_of_resolutions_is_computed(resolution: int) -> None:
    surface = _surface(SPHERE, _linear((1, 1, 1)), resolution)
    assert len(surface.triangles) == 20 * resolution**2

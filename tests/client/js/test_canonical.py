"""Canonical points and networks of every kind, drawn in Node, beside those of the service's code."""

import json
from pathlib import Path

import numpy as np
import pytest

from service.formats.weights import Weights, dump
from service.mapping.box import measure
from service.mapping.canonical import canonical_points
from service.mapping.sampler import Sampler
from service.mapping.spec import DOMAIN_DIMS, Array, Domain, MappingSpec, initial_theta
from tests.client.js.conftest import Run

pytestmark = pytest.mark.system

SEED, OFFSET, N = 2**64 - 5, 5, 1001
CANONICAL = """
import { canonicalPoints } from "hof-client";
const [domain, n, seed, offset] = JSON.parse(process.argv[1]);
console.log(JSON.stringify([...canonicalPoints(domain, n, BigInt(seed), offset)]));
"""
SAMPLE = """
import { readFile } from "node:fs/promises";
import { readFunctions, sample } from "hof-client";
const { buffer, byteOffset, length } = await readFile(process.argv[1]);
const functions = readFunctions(buffer.slice(byteOffset, byteOffset + length));
console.log(JSON.stringify([...sample(functions, 2000, { seed: 7 })]));
"""
SPECS = [
    MappingSpec("tanh", 3, (16, 24), 3, "tanh", k=2),
    MappingSpec("relu", 3, (16, 24), 3, k=3, domain="cube"),
    MappingSpec("four", 4, (32,), 3, domain="ball4"),
    MappingSpec("one", 3, (32,), 3, k=2, domain="sphere"),
]


def _numbers(npm: Run, code: str, argument: str) -> Array:
    return np.array(json.loads(npm("node", "--input-type=module", "--eval", code, argument)), np.float32)


@pytest.mark.parametrize("domain", DOMAIN_DIMS)
def test_canonical_points_are_those_of_the_service(npm: Run, built: Path, domain: Domain) -> None:
    points = _numbers(npm, CANONICAL, json.dumps([domain, N, str(SEED), OFFSET]))
    np.testing.assert_allclose(points, canonical_points(domain, N, SEED, OFFSET).ravel(), rtol=0, atol=1e-6)


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_points_of_a_network_are_those_of_the_service(npm: Run, built: Path, tmp_path: Path, spec: MappingSpec) -> None:
    theta = initial_theta(spec)
    frame = measure(spec, theta)
    (tmp_path / "function.safetensors").write_bytes(dump(Weights(spec, theta, "test", frame=frame), "safetensors"))
    points = _numbers(npm, SAMPLE, str(tmp_path / "function.safetensors"))
    expected = Sampler(spec, [theta] * spec.k, frame).points(2000, seed=7)
    np.testing.assert_allclose(points, expected.ravel(), rtol=0, atol=1e-4)

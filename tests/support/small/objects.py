"""Stored objects of the tiny model, and a weights file of another small spec."""

from typing import Any

import httpx

from service.formats.weights import Weights, dump
from service.mapping.spec import MappingSpec, initial_theta
from tests.support.photos import disc, image_file

SPEC = MappingSpec("small", 3, (8, 8), 3, activation="tanh", k=3, domain="cube")


def weights_file(seed: int = 0) -> bytes:
    """Return a safetensors file of random weights of `SPEC`."""
    return dump(Weights(SPEC, initial_theta(SPEC, seed), "elsewhere"), "safetensors")


def encode_discs(client: httpx.Client, *colors: str) -> list[str]:
    """Encode photos of discs; return the ids of their objects."""
    return [client.post("/encode", content=image_file(disc(color))).json()["id"] for color in colors]


def compose(client: httpx.Client, *ids: str, mode: str = "compose") -> dict[str, Any]:
    """Compose stored objects; return the answer."""
    item: dict[str, Any] = client.post("/compose", json={"objects": ids, "mode": mode}).json()
    return item

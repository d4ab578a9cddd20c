"""Answers of the Open Inference Protocol as frozen dataclasses, as in `answers`."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class InferenceServer:
    """The service, in the terms of the Open Inference Protocol."""

    name: str
    version: str
    extensions: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Live:
    """The process answers."""

    live: bool


@dataclass(frozen=True, kw_only=True)
class ServerReady:
    """The service is ready."""

    ready: bool


@dataclass(frozen=True, kw_only=True)
class ModelReady:
    """A model is ready."""

    name: str
    ready: bool


@dataclass(frozen=True, kw_only=True)
class Tensor:
    """An input or an output of a model; -1 in its shape stands for the batch."""

    name: str
    datatype: str
    shape: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class InferenceModel:
    """A model with its inputs and outputs."""

    name: str
    versions: tuple[str, ...]
    platform: str
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]


@dataclass(frozen=True, kw_only=True)
class TensorConfig:
    """An input or an output of a model, as Triton's configuration has it; `dims` has no batch."""

    name: str
    data_type: str
    dims: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class ModelConfig:
    """A model's configuration, as Triton's clients read it."""

    name: str
    platform: str
    backend: str
    max_batch_size: int
    input: tuple[TensorConfig, ...]
    output: tuple[TensorConfig, ...]

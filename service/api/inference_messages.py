"""JSON of the Open Inference Protocol, version 2: requests, and the descriptions of the service and its models."""

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field

CHANNELS: Final = (
    "Channels are red, green, blue, each a plane of rows from the top; sRGB levels divided by 255, so 0 to 1. The "
    "object stands over white, centered; its longer side fills the share `foreground_ratio` of the square (`/model` "
    "has it and the size)"
)


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class InputParameters(_Part):
    """Parameters of an input."""

    binary_data_size: int | None = Field(default=None, description="bytes of the tensor after the JSON")


class Input(_Part):
    """The input tensor: the images."""

    name: Literal["image"]
    shape: Annotated[list[int], FailFast()] = Field(description="(b, 3, size, size); `/v2/models/{name}` has the size")
    datatype: Literal["FP32"]
    parameters: InputParameters = InputParameters()
    data: list[Any] | None = Field(default=None, description=f"flat or nested. {CHANNELS}")


class OutputParameters(_Part):
    """Parameters of an output."""

    binary_data: bool | None = Field(default=None, description="send the output as bytes after the JSON, not in it")


class Output(_Part):
    """A requested output."""

    name: str
    parameters: OutputParameters = OutputParameters()


class RequestParameters(BaseModel):
    """Parameters of the whole request; unknown hints such as `priority` are ignored."""

    model_config = ConfigDict(strict=True)

    binary_data_output: bool = Field(default=False, description="`binary_data` of the outputs that do not set it")


class InferenceRequest(_Part):
    """The JSON of a request."""

    id: str | None = Field(default=None, max_length=200)
    parameters: RequestParameters = RequestParameters()
    inputs: Annotated[list[Input], Field(min_length=1, max_length=1)]
    outputs: Annotated[list[Output], Field(max_length=4)] = []


class InferenceServer(BaseModel):
    """The service, in the terms of the Open Inference Protocol."""

    name: str = Field(examples=["hof"])
    version: str
    extensions: list[str]


class Live(BaseModel):
    """The process answers."""

    live: Literal[True]


class ServerReady(BaseModel):
    """The service is ready."""

    ready: Literal[True]


class ModelReady(BaseModel):
    """A model is ready."""

    name: str = Field(examples=["hof1-k2"])
    ready: Literal[True]


class Tensor(BaseModel):
    """An input or an output of a model."""

    name: str = Field(examples=["image"])
    datatype: Literal["FP32"]
    shape: list[int] = Field(description="-1 stands for the batch", examples=[[-1, 3, 64, 64]])


class InferenceModel(BaseModel):
    """A model with its inputs and outputs."""

    name: str = Field(examples=["hof1-k2"])
    versions: list[str] = Field(description="always version 1: a changed model has another name", examples=[["1"]])
    platform: Literal["onnxruntime_onnx"]
    inputs: list[Tensor]
    outputs: list[Tensor]


class TensorConfig(BaseModel):
    """An input or an output of a model, as Triton's configuration has it."""

    name: str = Field(examples=["image"])
    data_type: Literal["TYPE_FP32"] = "TYPE_FP32"
    dims: list[int] = Field(description="without the batch", examples=[[3, 64, 64]])


class ModelConfig(BaseModel):
    """A model's configuration, as Triton's clients read it."""

    name: str = Field(examples=["hof1-k2"])
    platform: Literal["onnxruntime_onnx"] = "onnxruntime_onnx"
    backend: Literal["onnxruntime"] = "onnxruntime"
    max_batch_size: int = Field(examples=[8])
    input: list[TensorConfig]
    output: list[TensorConfig]


def request_schema() -> Mapping[str, Any]:
    """Return the JSON schema of a request, with all references inlined."""
    schema = InferenceRequest.model_json_schema()
    definitions = schema.pop("$defs")

    def inline(part: Any) -> Any:  # noqa: ANN401
        if isinstance(part, list):
            return [inline(each) for each in part]
        if not isinstance(part, dict):
            return part
        if "$ref" in part:
            part = definitions[part["$ref"].rpartition("/")[2]] | part
        return {key: inline(value) for key, value in part.items() if key != "$ref"}

    inlined: Mapping[str, Any] = inline(schema)
    return inlined

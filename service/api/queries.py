"""Parameters and JSON bodies of the API's calls. Unknown parameters are errors.

FastAPI reads a query field by field: for `POST /encode` that takes 50 microseconds even without parameters, and
`read_query` takes 3. So calls that come often use it, and list their parameters in the schema with `parameters_of`.
"""

from typing import Annotated, Any, Literal, TypeVar

from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from starlette.requests import Request

from service.formats.precision import Dtype
from service.formats.weights import WeightFormatName
from service.labels import LABEL_SCHEMA, MAX_LABEL, clean_label
from service.mapping.spec import MAX_K
from service.runtime.composition import Mode
from service.runtime.options import EncodeOptions, MeshOptions, PathOptions, PictureOptions, PointOptions

PointFormatName = Literal["ply", "npy", "xyz", "json", "glb", "gltf", "pcd", "f32", "f16"]
MeshFormatName = Literal["glb", "gltf", "obj", "stl", "ply", "usdz"]

ModelName = Annotated[
    str | None, Field(max_length=200, description="name of a loaded model; by default the first that `/models` lists")
]


class NoQuery(BaseModel):
    """A query without parameters: any parameter is an error."""

    model_config = ConfigDict(extra="forbid")


Query = TypeVar("Query", bound=NoQuery)


def read_query(request: Request, model: type[Query]) -> Query:
    """Return the parameters of a request. Raises RequestValidationError, as FastAPI does for those that it reads."""
    try:
        return model.model_validate(dict(request.query_params) if request.scope["query_string"] else {})
    except ValidationError as error:
        raise RequestValidationError([{**each, "loc": ("query", *each["loc"])} for each in error.errors()]) from error


def parameters_of(model: type[NoQuery]) -> list[dict[str, Any]]:
    """Return the OpenAPI parameters of a query that `read_query` reads."""
    schema = model.model_json_schema()
    return [
        {
            "name": name,
            "in": "query",
            "required": name in schema.get("required", []),
            "schema": {key: value for key, value in field.items() if (key, value) != ("default", None)},
            "description": field["description"],
        }
        for name, field in schema["properties"].items()
    ]


class EncodeQuery(EncodeOptions, NoQuery):
    """Parameters of `POST /encode`."""

    store: bool = Field(default=True, description="keep the object; `false` returns its weights and keeps nothing")
    keep_photo: bool = Field(
        default=False,
        description="keep a small picture of the photo's object, without what was taken for its background, for "
        "`/objects/{id}/photo`; the photo itself is never kept",
    )
    include: Literal["weights"] | None = Field(default=None, description="add `weights` to the answer")
    model: ModelName = None


class Label(NoQuery):
    """Body of `PATCH /objects/{id}`: the label to set."""

    model_config = ConfigDict(strict=True)

    label: str | None = Field(
        description=f"name of the object, one line of at most {MAX_LABEL} characters; null or an empty text removes it",
        examples=["Desk chair"],
        json_schema_extra=dict(LABEL_SCHEMA),
    )

    @field_validator("label")
    @classmethod
    def _clean(cls, value: str | None) -> str | None:
        return clean_label(value or "")


class ModelQuery(NoQuery):
    """Model selection."""

    model: ModelName = None


class PageQuery(NoQuery):
    """Position in the list of objects."""

    limit: int = Field(default=50, ge=1, le=500, description="maximum number of items of the page")
    cursor: str | None = Field(default=None, max_length=64, description="`next` of the previous page")


class PointsQuery(PointOptions, NoQuery):
    """Parameters of `GET /objects/{id}/points`."""

    format: PointFormatName | None = Field(
        default=None, description="file format; wins over `Accept`; PLY if neither names one"
    )


class MeshQuery(MeshOptions, NoQuery):
    """Parameters of `GET /objects/{id}/mesh`."""

    format: MeshFormatName | None = Field(
        default=None, description="file format; wins over `Accept`; GLB if neither names one"
    )


class PictureQuery(PictureOptions, NoQuery):
    """Parameters of `GET /objects/{id}/picture`."""

    format: Literal["png", "webp", "gif"] | None = Field(
        default=None,
        description="file format; wins over `Accept`; PNG if neither names one, WebP if `frames` is above 1",
    )


class PathQuery(NoQuery):
    """Parameters of `POST /objects/{id}/path`."""

    format: Literal["json", "glb"] | None = Field(
        default=None, description="file format; wins over `Accept`; JSON if neither names one"
    )


class PathBody(PathOptions, NoQuery):
    """Body of `POST /objects/{id}/path`: the path to plan."""

    model_config = ConfigDict(strict=True)

    @field_validator("cells", mode="before")
    @classmethod
    def _whole(cls, value: object) -> object:
        """Return 32 for 32.0, which is an integer in a JSON schema."""
        return int(value) if isinstance(value, float) and value.is_integer() else value


class WeightsQuery(NoQuery):
    """Parameters of `GET /objects/{id}/weights`."""

    format: WeightFormatName = Field(
        default="safetensors",
        description="file format; `safetensors` carries the spec and can be posted to `/objects`; `onnx` is the whole "
        "function, k included: x (n, input_dim) -> points (n, 3), float32; `json` holds at most 1,000,000 numbers",
    )
    dtype: Dtype = Field(
        default="float32",
        description="type of the numbers in the file; `float16` halves the bytes and `int8` quarters them, for "
        "`safetensors` alone, and `loss` in its metadata tells how far points move then",
    )


class Composition(NoQuery):
    """Body of `POST /compose`: the objects to combine, and how."""

    objects: list[str] = Field(
        min_length=1,
        max_length=MAX_K,
        description="ids of objects of one spec, none of them composed: k for `compose`, two or more for "
        "`interpolate`, two for `all`",
        examples=[["2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b", "9b1d1c4d5e6f7a8b2f7f3b52a9a1c0de"]],
    )
    mode: Mode = Field(
        default="compose",
        description="`compose` makes the word: for A, B the function f_A(f_B(x)), so that the last one is applied "
        "first. `all` makes the 2^k words over two objects, in lexicographic order: AA, AB, BA, BB. `interpolate` "
        "averages theta; an object named twice weighs twice",
    )

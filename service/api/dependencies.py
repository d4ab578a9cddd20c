"""Dependencies that several routes share."""

from typing import Annotated

from fastapi import Depends, Path
from starlette.requests import Request

from service.errors import NotFound, NotReady
from service.runtime.parts import Runtime
from service.storage.ids import ID_DIGITS, MAX_QUOTED, is_id


async def ready_runtime(request: Request) -> Runtime:  # async: FastAPI would call it on a thread otherwise
    """Return the opened parts of the service. Raises NotReady before they are opened and after they are closed."""
    runtime: Runtime | None = request.app.state.runtime
    if runtime is None:
        raise NotReady("the service is starting or stopping")
    return runtime


async def object_id(id_: Annotated[str, Path(alias="id", description="id of an object")]) -> str:
    """Return the id in the path. Raises NotFound for a malformed one, without a query to the database."""
    if not is_id(id_):
        raise NotFound(f"no object has the id {id_[:MAX_QUOTED]!r}: ids are {ID_DIGITS} hexadecimal digits")
    return id_


ReadyRuntime = Annotated[Runtime, Depends(ready_runtime)]
ObjectId = Annotated[str, Depends(object_id)]

"""A rule for the query of every request."""

from collections import Counter

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api import problems
from service.errors import InvalidParameter


class RefuseRepeatedParameters:
    """Refuse a request that gives a parameter twice, instead of silently dropping one."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with 422."""
        if scope["type"] == "http" and b"&" in scope["query_string"]:
            names = [name for name, _ in Request(scope).query_params.multi_items()]
            repeated = next((name for name, count in Counter(names).items() if count > 1), None)
            if repeated is not None:
                refusal = problems.respond(InvalidParameter("a parameter may be given once", field=repeated[:64]))
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)

"""Rules for the query of every request, checked before anything else looks at it."""

from collections import Counter
from typing import Final

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api import problems
from service.errors import InvalidParameter

MAX_PARAMETERS: Final = 64  # of one query: no call has a dozen


class CheckQuery:
    """Refuse a query of more than `MAX_PARAMETERS` parameters, or with a parameter given twice.

    The number is counted before the query is parsed, because parsing and validating thousands would hold the event
    loop. Of a parameter that is given twice, one would be dropped silently otherwise.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with 422."""
        if scope["type"] == "http" and b"&" in scope["query_string"]:
            try:
                _check(scope)
            except InvalidParameter as error:
                await problems.respond(error)(scope, receive, send)
                return
        await self._app(scope, receive, send)


def _check(scope: Scope) -> None:
    """Raise InvalidParameter for a query that no call may have."""
    count = scope["query_string"].count(b"&") + 1
    if count > MAX_PARAMETERS:
        raise InvalidParameter(f"the query has {count} parameters, at most {MAX_PARAMETERS} are allowed")
    names = [name for name, _ in Request(scope).query_params.multi_items()]
    for name, times in Counter(names).items():
        if times > 1:
            raise InvalidParameter("a parameter may be given once", field=name)

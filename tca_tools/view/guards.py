"""The guards of a page's server.

The page comes from this machine only, and the server answers only to its own address: a foreign
page that a browser shows can't read anything through it (DNS rebinding). Where other machines reach
it, it asks for a token. Only a page opened with the address that the command printed may change
anything: its key is known to nobody else. So neither a page of another site, nor another user of
this machine, who may look, can.
"""

from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from hmac import compare_digest
from secrets import token_urlsafe
from urllib.parse import urlsplit

from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response

from tca_tools.errors import ToolError

TOKEN = "access"  # noqa: S105 - the name of it
"""The parameter of the address, and the cookie, that has the token."""

_LOOKS = {
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:;"
    " frame-ancestors 'none'",  # nobody's click on another page is one on this one
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


class NotAllowed(ToolError):
    """The page may only look."""


class PageKey:
    """What a page must have to change anything."""

    def __init__(self, command: str) -> None:
        self._command = command
        self.text = token_urlsafe(16)

    def check(self, headers: Mapping[str, str]) -> None:
        """Raise NotAllowed unless a request comes from a page of this server that has the key."""
        origin = headers.get("Origin", "")
        if origin and urlsplit(origin).netloc != headers.get("Host", ""):
            raise NotAllowed(f"a page of {origin} may not steer")
        if not compare_digest(headers.get("X-TCA-Key", "").encode(), self.text.encode()):
            raise NotAllowed(
                f"this page may only look: to steer, open the address that '{self._command}' printed"
            )


def guards(hosts: list[str], token: str, command: str) -> list[Middleware]:
    """The guards of a server that answers to these host names, and where there is a *token* only to
    those who have opened the address that has it.
    """
    made = [Middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False)]
    made.append(Middleware(BaseHTTPMiddleware, dispatch=_with_looks))
    if token:
        ask = partial(_with_token, token, command)
        made.append(Middleware(BaseHTTPMiddleware, dispatch=ask))
    return [*made, Middleware(GZipMiddleware, compresslevel=3)]


async def _with_looks(
    request: Request, go_on: Callable[[Request], Awaitable[Response]]
) -> Response:
    response = await go_on(request)
    response.headers.update(_LOOKS)
    return response


async def _with_token(
    token: str, command: str, request: Request, go_on: Callable[[Request], Awaitable[Response]]
) -> Response:
    """Answer those who know the token; a browser keeps it, and it leaves the address."""
    shown = request.query_params.get(TOKEN, "") if request.url.path == "/" else ""
    if shown and compare_digest(shown.encode(), token.encode()):
        response: Response = RedirectResponse("/", 303)
        response.set_cookie(TOKEN, token, httponly=True, samesite="strict")
        return response
    if not compare_digest(request.cookies.get(TOKEN, "").encode(), token.encode()):
        return PlainTextResponse(
            f"open the address that '{command}' has printed: it has a token\n", 403
        )
    return await go_on(request)

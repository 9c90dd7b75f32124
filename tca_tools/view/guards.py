"""The guards of a page's server.

By default the server listens on this machine only, and answers only to its own host name. So a page
of another site can't read from the server in the user's browser (DNS rebinding). A server that
other machines can reach requires a token. Changes require a key, which is part of the address that
the command printed. Without the key, neither a page of another site nor another user of this
machine can steer.
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

TOKEN = "access"  # noqa: S105 - the name of the parameter
"""The parameter of the address, and the cookie, with the token."""

_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data:;"
    " frame-ancestors 'none'",  # against clickjacking
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


class NotAllowed(ToolError):
    """The page may not change anything."""


class PageKey:
    """The key that a page needs to change anything."""

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
                f"this page is read-only: to steer, open the address that '{self._command}' printed"
            )


def guards(hosts: list[str], token: str, command: str) -> list[Middleware]:
    """Return the guards of a server.

    Args:
        hosts: the host names that it answers to.
        token: the token that it requires; "": none.
        command: the command that printed the address, for errors.
    """
    made = [Middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False)]
    made.append(Middleware(BaseHTTPMiddleware, dispatch=_with_headers))
    if token:
        check = partial(_with_token, token, command)
        made.append(Middleware(BaseHTTPMiddleware, dispatch=check))
    return [*made, Middleware(GZipMiddleware, compresslevel=3)]


async def _with_headers(
    request: Request, proceed: Callable[[Request], Awaitable[Response]]
) -> Response:
    response = await proceed(request)
    response.headers.update(_HEADERS)
    return response


async def _with_token(
    token: str, command: str, request: Request, proceed: Callable[[Request], Awaitable[Response]]
) -> Response:
    """Answer a request that has the token. Move a token from the address into a cookie."""
    shown = request.query_params.get(TOKEN, "") if request.url.path == "/" else ""
    if shown and compare_digest(shown.encode(), token.encode()):
        response: Response = RedirectResponse("/", 303)
        response.set_cookie(TOKEN, token, httponly=True, samesite="strict")
        return response
    if not compare_digest(request.cookies.get(TOKEN, "").encode(), token.encode()):
        return PlainTextResponse(
            f"open the address that '{command}' has printed: it has a token\n", 403
        )
    return await proceed(request)

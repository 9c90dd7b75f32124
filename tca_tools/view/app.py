"""What the page asks the server for, over HTTP. Answers from a Reading; changes nothing, and fetches nothing.

The page comes from this machine only, and the server answers only to its own address: a foreign page that a browser
shows can't read a run through it (DNS rebinding).
"""

import json
import math
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from tca_tools.tasktree_viz.dot import FILLS
from tca_tools.view.answers import message_answer, messages_answer, notes_answer, numbers
from tca_tools.view.feed import OUTCOMES, ROLES, STATES, SpanKind
from tca_tools.view.reading import Reading

PAGE = Path(__file__).parent / "page"
_PATIENCE = 10.0
"""Seconds that a page's question for news may stay open."""

_LOOKS = {
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-cache",
}


def application(reading: Reading, hosts: list[str]) -> Starlette:
    """The server of one page, which answers to these host names."""
    return Starlette(
        routes=[
            Route("/", _page),
            Route("/api/frame", partial(_frame, reading)),
            Route("/api/message/{id:int}", partial(_message, reading)),
            Route("/api/notes", partial(_notes, reading)),
            Route("/api/messages", partial(_messages, reading)),
            Mount("/page", StaticFiles(directory=PAGE)),
        ],
        middleware=[
            Middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False),
            Middleware(BaseHTTPMiddleware, dispatch=_with_looks),
            Middleware(GZipMiddleware, compresslevel=3),
        ],
    )


async def _with_looks(request: Request, go_on: Callable[[Request], Awaitable[Response]]) -> Response:
    response = await go_on(request)
    response.headers.update(_LOOKS)
    return response


async def _page(_request: Request) -> Response:
    return FileResponse(PAGE / "index.html")


async def _frame(reading: Reading, request: Request) -> Response:
    """What is new since the page last asked; waits for it a while if the page has all there is (not with ``wait=0``)."""
    since = _lengths(request.query_params.get("since", "{}"))
    patience = 0.0 if request.query_params.get("wait") == "0" else _PATIENCE
    frame = await run_in_threadpool(_next_frame, reading, since, patience)
    return Response(frame, media_type="application/octet-stream")


def _next_frame(reading: Reading, since: dict[str, int], patience: float) -> bytes:
    with reading:
        if since:  # a page that has nothing yet gets what there is
            reading.wait_for_more(since.get("entry", 0), patience)
        history = reading.feed.history
        told = {
            "name": reading.log.name,
            "began": history.began,
            "caughtUp": reading.caught_up,
            "state": reading.state,
            "now": reading.now,
            "problem": reading.problem or reading.log.cut,
            "remark": reading.remark,
            "states": [{"name": state, "colour": FILLS[state]} for state in STATES],
            "colours": reading.feed.colours(),
            "outcomes": [outcome or "" for outcome in OUTCOMES],
            "roles": ROLES,
            "kinds": [kind.name.lower() for kind in SpanKind],
        }
        return reading.feed.columns.frame(since, told)


async def _message(reading: Reading, request: Request) -> Response:
    moment = _moment(request)
    answer = await run_in_threadpool(message_answer, reading, request.path_params["id"], moment)
    if answer is None:
        return JSONResponse({"error": f"no message {request.path_params['id']} in this journal"}, 404)
    return JSONResponse(answer)


async def _notes(reading: Reading, request: Request) -> Response:
    ids = numbers(request.query_params.get("ids", ""))
    return JSONResponse(await run_in_threadpool(notes_answer, reading, ids, _moment(request)))


async def _messages(reading: Reading, request: Request) -> Response:
    around = [numbers(request.query_params.get(name, "")) for name in ("place", "before", "after")]
    place, before, after = (given[0] if given else 0 for given in around)
    return JSONResponse(await run_in_threadpool(messages_answer, reading, place, before, after))


def _moment(request: Request) -> float:
    try:
        moment = float(request.query_params.get("at", "inf"))
    except ValueError:
        return math.inf
    return math.inf if math.isnan(moment) else moment


def _lengths(text: str) -> dict[str, int]:
    """How much of each table the page has; nothing, if it does not say so properly."""
    try:
        given = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(given, dict):
        return {}
    return {name: length for name, length in given.items() if isinstance(length, int) and 0 <= length < 1 << 53}

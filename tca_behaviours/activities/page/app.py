"""The web application that serves the page."""

from functools import partial
from pathlib import Path

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from tca_behaviours.activities.page.live import LiveApplication, PageCommand
from tca_module import TcaError
from tca_tools.view.app import PAGE as VIEW
from tca_tools.view.guards import NotAllowed, PageKey, guards

STATIC = Path(__file__).parent / "static"
_PATIENCE = 10.0
"""Seconds that a page's request for changes may stay open."""


def page_app(
    live: LiveApplication, hosts: list[str], key: PageKey | None = None, token: str = ""
) -> Starlette:
    """Return the web application that serves one page.

    Args:
        live: the application that the page shows.
        hosts: the names by which browsers may address the server.
        key: the key for commands; None: the page is read-only.
        token: if given, the server answers only browsers that have opened the address with this
            token.
    """
    return Starlette(
        routes=[
            Route("/", lambda _request: FileResponse(STATIC / "index.html")),
            Route("/api/news", partial(_news, live)),
            *([Route("/api/send", partial(_send, live, key), methods=["POST"])] if key else []),
            Mount("/static", StaticFiles(directory=STATIC)),
            Mount("/view", StaticFiles(directory=VIEW)),
        ],
        middleware=guards(hosts, token, "tca activities"),
    )


async def _news(live: LiveApplication, request: Request) -> Response:
    since = request.query_params.get("since", "0")
    return JSONResponse(
        await run_in_threadpool(live.changes_since, int(since) if since.isdigit() else 0, _PATIENCE)
    )


async def _send(live: LiveApplication, key: PageKey, request: Request) -> Response:
    """Send a command, and answer with its outcome."""
    try:
        key.check(request.headers)
        command = msgspec.json.decode(await request.body(), type=PageCommand)
        return JSONResponse({"said": await run_in_threadpool(live.send, command)})
    except NotAllowed as error:
        return JSONResponse({"error": error.message}, 403)
    except TcaError as error:
        return JSONResponse({"error": str(error)})  # a refusal is a normal answer
    except msgspec.MsgspecError as error:
        return JSONResponse({"error": str(error)}, 400)

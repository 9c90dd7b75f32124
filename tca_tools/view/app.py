"""The HTTP server of the page.

It answers from a Reading. To steer a task of a live run, it calls the same functions as ``tca
kill``. Handlers that wait are plain functions: Starlette calls these in a thread.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import click
import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from tca_tools.errors import ToolError
from tca_tools.journal.coordinators import STANDINGS as PREVIEWED
from tca_tools.journal.fates import HANDLED
from tca_tools.live.steering import steer
from tca_tools.tasktree_viz.dot import FILLS
from tca_tools.view import answers
from tca_tools.view.guards import NotAllowed, PageKey, guards
from tca_tools.view.machines import machine_picture
from tca_tools.view.outcomes import Outcomes
from tca_tools.view.reading import Reading
from tca_tools.view.runs import Runs, ShownRun
from tca_wire.points import TaskId

PAGE = Path(__file__).parent / "page"
_PATIENCE = 10.0
"""Seconds that a request for new rows may stay open."""
_PATIENCE_ENDED = 2.0
"""The same for a run that has ended. It is shorter, since a new run may start."""


class SteeringRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A page's request to steer a task."""

    run: str
    """The address of the run that the page shows."""
    task: int
    what: str
    why: Annotated[str, msgspec.Meta(max_length=1000)] = ""


@dataclass(frozen=True)
class Steering:
    """The address of the central that pages may steer (None: the default), and the key for it."""

    central: str | None
    key: PageKey = field(default_factory=partial(PageKey, "tca view"))


def application(
    runs: Runs, hosts: list[str], steering: Steering | None = None, token: str = ""
) -> Starlette:
    """Create the server of the page.

    Args:
        runs: the runs to show.
        hosts: the host names that it answers to.
        steering: the central to steer; None: the page is read-only.
        token: the token that requests must have; "": none.
    """
    routes: list[BaseRoute] = [
        Route("/", lambda _request: FileResponse(PAGE / "index.html")),
        Route("/api/runs", partial(_runs, runs)),
        Route("/api/outcome", partial(_outcome, Outcomes(runs))),
        Route("/api/frame", partial(_frame, runs)),
        Mount("/page", StaticFiles(directory=PAGE)),
    ]
    routes += [
        Route(f"/api/{path}", partial(_answer_about_run, runs, answer))
        for path, answer in _ANSWERS.items()
    ]
    if steering:
        routes.append(Route("/api/steer", partial(_steer, runs, steering), methods=["POST"]))
    return Starlette(routes=routes, middleware=guards(hosts, token, "tca view"))


def _runs(runs: Runs, _request: Request) -> Response:
    """Return the runs that can be chosen, newest first."""
    found = runs.all()
    last = found[-1].address if found else ""
    if runs.follows:
        last = runs.newest.address
    rows = [
        {"run": one.address, "name": one.name, "began": one.began, "isNewest": one.address == last}
        for one in reversed(found)
    ]
    return JSONResponse(rows)


def _outcome(outcomes: Outcomes, request: Request) -> Response:
    """Return the outcome of a run, whether the page shows it or not."""
    address = request.query_params.get("run", "")
    found = outcomes.of(address)
    return _no_run(address) if found is None else JSONResponse(found)


def _frame(runs: Runs, request: Request) -> Response:
    """Return the rows since the page's last request.

    If there are none, wait a while for new ones, unless the request has ``wait=0``.
    """
    asked = request.query_params
    since, token = _lengths(asked.get("since", "{}")), asked.get("token")
    if (shown := runs.show(asked.get("run"))) is None:
        return _no_run(asked.get("run"))
    if since and token is not None and token != shown.token:
        return JSONResponse({"error": "the journal is read again: discard the earlier rows"}, 410)
    reading = shown.reading
    if since and asked.get("wait") != "0":  # a page without rows gets an answer at once
        with reading:
            patience = _PATIENCE if reading.state == "live" else _PATIENCE_ENDED
            reading.wait_for_more(since.get("entry", 0), patience)
    with reading:
        frame = reading.feed.columns.frame(since, _head(runs, shown))
    return Response(frame, media_type="application/json")


def _head(runs: Runs, shown: ShownRun) -> dict[str, Any]:
    """Return the fields of a frame besides the columns."""
    run, newest = runs.names(shown)
    reading = shown.reading
    return {
        "run": run.address,
        "token": shown.token,
        "name": run.name,
        "began": reading.feed.history.began,
        "caughtUp": reading.caught_up,
        "state": reading.state,
        "now": reading.now,
        "problem": reading.problem or reading.cut,
        "remark": reading.remark,
        "fills": FILLS,
        "handled": HANDLED,
        "previewed": PREVIEWED,
        "colours": reading.feed.colours(),
        "follows": runs.follows,
        "newest": {"run": newest.address, "name": newest.name},
        "newestAtStart": runs.newest_at_start,
    }


async def _steer(runs: Runs, steering: Steering, request: Request) -> Response:
    """Steer a task of a live run, and return the result as a sentence."""
    headers = request.headers
    try:
        steering.key.check(headers)
        asked = msgspec.json.decode(await request.body(), type=SteeringRequest)
        return JSONResponse({"said": await run_in_threadpool(_steered, runs, steering, asked)})
    except NotAllowed as error:
        return JSONResponse({"error": error.message}, 403)
    except (click.ClickException, msgspec.MsgspecError) as error:
        return JSONResponse({"error": getattr(error, "message", None) or str(error)}, 400)


def _steered(runs: Runs, steering: Steering, asked: SteeringRequest) -> str:
    if (shown := runs.show(asked.run)) is None or shown.reading.state != "live":
        raise ToolError("this run has ended: nothing can be done to its tasks")
    epoch = shown.reading.feed.history.epoch
    return steer(steering.central, epoch, asked.what, asked.task, asked.why)


def _no_run(address: str | None) -> Response:
    return JSONResponse({"error": f"there is no run '{address}' any more"}, 404)


def _answer_about_run(
    runs: Runs, answer: Callable[[Reading, Request], Any], request: Request
) -> Response:
    """Return the answer to a request about the run that the page shows, or "not found"."""
    address = request.query_params.get("run")
    if (shown := runs.show(address)) is None:
        return _no_run(address)
    if (found := answer(shown.reading, request)) is None:
        shown.reading.wait_until_read()
        found = answer(shown.reading, request)
    if found is None:
        return JSONResponse({"error": f"no message {_id(request)} in this journal"}, 404)
    return JSONResponse(found)


def _time(request: Request) -> float:
    try:
        time = float(request.query_params.get("at", "inf"))
    except ValueError:
        return math.inf
    return math.inf if math.isnan(time) else time


def _id(request: Request) -> int:
    return int(request.path_params["id"])


def _numbers(request: Request, name: str) -> list[int]:
    """Return the numbers of a list such as "3,17", without other parts."""
    parts = request.query_params.get(name, "").split(",")
    return [TaskId(int(part)) for part in parts if part.isdecimal() and len(part) < 16]


def _number(request: Request, name: str) -> int:
    return next(iter(_numbers(request, name)), 0)


_ANSWERS: dict[str, Callable[[Reading, Request], Any]] = {
    "message/{id:int}": lambda read, asked: answers.message_answer(read, _id(asked), _time(asked)),
    "machine/{id:int}": lambda read, asked: machine_picture(read, _id(asked)),
    "picture/{id:int}": lambda read, asked: answers.picture_answer(read, _id(asked)),
    "notes": lambda read, asked: answers.notes_answer(read, _numbers(asked, "ids"), _time(asked)),
    "causes": lambda read, asked: answers.causes_answer(read, _time(asked)),
    "messages": lambda read, asked: answers.messages_answer(
        read, *(_number(asked, name) for name in ("place", "before", "after"))
    ),
}
"""The answers about the run that the page shows."""


def _lengths(text: str) -> dict[str, int]:
    """Return the number of rows that the page has of each table; empty if the text is invalid."""
    try:
        return msgspec.json.decode(
            text, type=dict[str, Annotated[int, msgspec.Meta(ge=0, lt=1 << 53)]]
        )
    except (msgspec.MsgspecError, RecursionError):
        return {}

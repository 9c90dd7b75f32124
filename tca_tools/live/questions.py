"""Commands that show the state of a running central.

They are ``tca status``, ``modules``, ``messages``, ``variables`` and ``attached``.
"""

import json
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import click
import msgspec

from tca_module.client import Client
from tca_tools.live.shared import as_json, json_option, live_command, plain
from tca_tools.live.top_frame import memory_in_words
from tca_tools.terminal import table_lines
from tca_wire.errors import BadData
from tca_wire.messages.formats import decode_untyped
from tca_wire.text.measures import counted, listed, numbered
from tca_wire.text.printable import printable
from tca_wire.text.waits_in_words import in_words, several_in_words, waiter_in_words
from tca_wire.waits import CommonEnd, Waiter, WaitKind

_SHOWN = 20
"""Waiters that are shown."""
_LONGEST_VALUE = 60
"""Characters of a variable's value in a table."""
_STATES = ("waits", "suspended", "killed", "held")
"""The lists of waiters in central's answer.

They are: messages, handlers and modules that wait; suspended, killed and held tasks.
"""

Rows = list[list[str]]


def _status_command(name: str) -> Callable[[Callable[[Client], tuple[Any, str]]], click.Command]:
    """Make a command of a function that returns an answer as data and as text."""

    def command_of(answer: Callable[[Client], tuple[Any, str]]) -> click.Command:
        @live_command(name)
        @json_option
        @wraps(answer)
        def command(client: Client, *, in_json: bool) -> None:
            data, text = answer(client)
            click.echo(as_json(data) if in_json else text)

        return command

    return command_of


@_status_command("status")
def status(client: Client) -> tuple[Any, str]:
    """Show the state of central, and what waits for what."""
    overview, load = client.status("status"), client.status("load")
    for what in ("modules", "connections"):
        overview[what] -= 1  # this command is not counted
    waiting = _waiting(load)
    awaited, needs_resume = overview.get("awaited"), overview.get("to be told")
    shown = [
        counted(number, what.removesuffix("s")) if what.endswith("s") else f"{number:,} {what}"
        for what, number in overview.items()
        if what not in ("epoch", "newest id", "awaited", "to be told", "members")
        and (number or what != "forgotten answers")
    ]
    shown.append(memory_in_words(load))
    parts = [
        f"central at {client.address}, run {overview['epoch']}",
        *textwrap.wrap(", ".join(shown), 100),
    ]
    if awaited is not None:
        event = f"{printable(listed(awaited))} to come back" if awaited else "a resume"
        more = "; 'tca resume' starts them" if needs_resume or awaited else ""
        parts.append(f"central was restarted, and starts no tasks yet: it waits for {event}{more}")
    parts += _members(overview.get("members"))
    lost = sorted(load["messages"], key=lambda one: -int(one["dropped"]))
    if dropped := [f"{one['dropped']:,} of {one['message']}" for one in lost if one["dropped"]]:
        parts.append(f"dropped: {printable(listed(dropped))}")
    if waiting:
        rows = [[one["what"], one["for"]] for one in waiting[:_SHOWN]]
        parts += ["", _table("waiting, for", rows)]
        listed_of = Counter(one["state"] for one in waiting)
        totals = (max(load["totals"].get(state, 0), listed_of[state]) for state in _STATES)
        left = sum(totals) - _SHOWN
        parts += [f"... and {'at least ' * _is_cut(load)}{left:,} more"] * (left > 0)
    if ends := _ends(load):
        parts += ["", *ends]
    data = {
        what: load[what] for what in ("time", "totals", "looked_at", "ends", "memory", "overloads")
    }
    return {**overview, "waiting": waiting, **data}, "\n".join(parts)


def _members(members: dict[str, Any] | None) -> list[str]:
    """Say which centrals lead and follow a replicated log, if there is one."""
    if members is None:
        return []
    lines = [f"{members['leader']} leads, at {members['address']}"]
    for one in members["standbys"]:
        can = "leads if a person says so" if one["is_manual"] else "can take over"
        can = f"is {one['behind']} s behind" if one["behind"] else can
        lines.append(f"{one['process']} follows, at {one['address']}: it {can}")
    if not members["standbys"]:
        lines.append("no standby follows: start one with 'tca standby'")
    return [printable(line) for line in lines]


def _waiting(load: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the waiters and their causes, as data and in words."""
    found = []
    for state in _STATES:
        for data in load[state]:
            waiter = msgspec.convert(data, Waiter)
            why = _why(waiter, load["time"], shows_end=len(load["ends"]) > 1)
            found.append({"what": waiter_in_words(waiter), "for": why, "state": state, **data})
    return found


def _is_cut(load: dict[str, Any]) -> bool:
    """Whether central searched only the older tasks for held ones."""
    return bool(load["looked_at"] < load["tasks"])


def _ends(load: dict[str, Any]) -> list[str]:
    """Count the held tasks by their final wait, and say how many tasks central searched."""
    ends = msgspec.convert(load["ends"], list[CommonEnd])
    is_part = _is_cut(load) or sum(end.tasks for end in ends) < load["totals"]["held"]
    lines = []
    for end in ends:
        waiters = f"{counted(end.tasks, 'held task')} wait{'s' * (end.tasks == 1)}"
        wait = in_words(end.wait, load["time"])
        lines.append(f"{'at least ' * is_part}{waiters} in the end {wait}")
    if _is_cut(load):
        lines.append(f"only the {load['looked_at']:,} oldest tasks were searched for held ones")
    return lines


def _why(waiter: Waiter, now: float, *, shows_end: bool) -> str:
    """Return a waiter's causes in words, with its final wait on request and the task to resume."""
    why = several_in_words(waiter.waits, now)
    if waiter.killed:
        return f"{why} (killed: {waiter.killed})"
    if shows_end and waiter.end is not None:
        why += f"; in the end {in_words(waiter.end, now)}"
    suspended = next(
        (one.number or waiter.number for one in waiter.waits if one.kind is WaitKind.RESUME), 0
    )
    return f"{why}: 'tca resume {suspended}'" if suspended else why


@_status_command("modules")
def modules(client: Client) -> tuple[Any, str]:
    """List the connected modules with their resources and messages."""
    known = [module for module in client.status("modules") if module["module"] != client.name]
    rows: Rows = []
    for module in known:
        first = [module["module"], module["process"], ", ".join(module["handles"]) or "-"]
        for resource in module["resources"] or [None]:
            rows.append([*first[:2], *_about_resource(resource), first[2]])
            first = ["", "", ""]
    heads = "module, process, resource, capacity, handling, waiting, handles"
    return known, _table(heads, rows) or "no modules are connected"


def _about_resource(resource: dict[str, Any] | None) -> list[str]:
    """Return the cells of a resource: name, capacity, handled ids and its holder, queue length."""
    if resource is None:
        return ["-", "", "", ""]
    parts = [", ".join(map(str, resource["handling"]))]
    parts += [
        f"{how} by {resource[f'{how}_by']}"
        for how in ("locked", "reserved")
        if resource[f"{how}_by"]
    ]
    handling = "; ".join(filter(None, parts)) or "-"
    return [
        resource["resource"],
        str(resource["capacity"]),
        handling,
        str(resource["waiting"] or ""),
    ]


@_status_command("messages")
def messages(client: Client) -> tuple[Any, str]:
    """List the declared messages and their handlers."""
    known = sorted(client.status("messages"), key=lambda message: str(message["message"]))
    rows = []
    for message in known:
        handlers = [one["module"] for one in message["handled_by"]]
        rows.append(
            [message["message"], message["class"], _names(handlers), str(message["waiting"] or "")]
        )
    table = _table("message, class, handled by, waiting", rows)
    return known, table or "no messages have been declared"


@_status_command("variables")
def variables(client: Client) -> tuple[Any, str]:
    """List the shared variables with their values.

    Each line names the module that set the variable last, and the modules that watch it.
    """
    known = sorted(client.status("variables"), key=lambda variable: str(variable["variable"]))
    rows = []
    for variable in known:
        value = _decoded(variable["value"])
        variable["value"] = plain(value)
        watched_by = _names(variable["watched_by"])
        rows.append(
            [
                variable["variable"],
                _shown_value(variable, value),
                variable["set_by"] or "-",
                watched_by,
            ]
        )
    table = _table("variable, value, set by, watched by", rows)
    return known, table or "no variables have been declared"


@_status_command("attached")
def attached(client: Client) -> tuple[Any, str]:
    """List the exception handlers, wiretaps and monitors in force.

    Each line names its place and the modules that attached it. An attachment stays when its module
    leaves: 'tca detach NUMBER' removes it. "An earlier run" marks a module that attached it before
    its restart, but not since. 'tca detach --stale' removes attachments that no other module has.
    """
    known = client.status("attached")
    handlers = [
        [
            str(one["id"]),
            one["failure"] or "any failure",
            attached_to(one),
            one["handler"],
            str(one["maximum"] or ""),
            _owners(one),
            _names(one["handled_by"]),
        ]
        for one in known["exception_handlers"]
    ]
    taps = [
        [
            str(one["id"]),
            one["condition"],
            attached_to(one),
            one["listener"],
            _owners(one),
            "central" if one["is_monitor"] else _names(one["handled_by"]),
        ]
        for one in known["wiretaps"]
    ]
    monitors = [
        [str(one["id"]), one["monitor"], attached_to(one), _owners(one)]
        for one in known["monitors"]
    ]
    cut = attached_in_all(known)
    texts = [
        _table(
            "number, failure, of, exception handler, at most, attached by, handled by", handlers
        ),
        _table("number, wiretap, of, listener, tapped by, handled by", taps),
        _table("number, monitor, under, sent by", monitors),
        cut and f"only the first are listed: there are {cut}",
    ]
    return known, "\n\n".join(filter(None, texts)) or "no exception handlers, wiretaps or monitors"


def attached_in_all(known: dict[str, Any]) -> str:
    """Return the totals of lists that central cut short: "12,000 monitors"; "" if it cut none."""
    totals: dict[str, int] = known["totals"]
    cut = [
        f"{number:,} {kind.replace('_', ' ')}"
        for kind, number in totals.items()
        if number > len(known[kind])
    ]
    return ", ".join(cut)


def attached_to(one: dict[str, Any]) -> str:
    """Return the place of an attachment: "walk {7}", "all walk", "the root"."""
    if one["task"]:
        return numbered(one["message"], one["task"])
    return f"all {one['message']}" if one["message"] else "the root"


def _owners(one: dict[str, Any]) -> str:
    marks = dict.fromkeys(one["gone"], " (has left)") | dict.fromkeys(
        one["earlier"], " (an earlier run)"
    )
    return ", ".join(name + marks.get(name, "") for name in one["modules"])


def _names(modules: Sequence[str]) -> str:
    return ", ".join(modules) or "-"


def _decoded(body: bytes) -> Any:
    """Return a value; None if it was never set or can't be decoded."""
    try:
        return decode_untyped(body)
    except BadData:
        return None


def _shown_value(variable: dict[str, Any], value: Any) -> str:
    if not variable["bytes"]:
        return "(never set)"
    text = json.dumps(plain(value, is_shown=True), ensure_ascii=False)
    is_shown = value is not None and len(text) <= _LONGEST_VALUE
    return text if is_shown else f"({variable['bytes']} bytes)"


def _table(heads: str, rows: Rows) -> str:
    """Return the rows as text below their heads, which commas separate; "" without rows."""
    cells = [[*map(printable, row)] for row in [heads.split(", "), *rows]]
    return "\n".join(table_lines(cells)) if rows else ""

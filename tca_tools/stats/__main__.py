"""``tca stats``: how many messages, how long they took, how busy the resources were."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tca_tools.options import MOMENT, check_span, log_argument
from tca_tools.run.folding import folded
from tca_tools.run.journals import open_log
from tca_tools.stats.measure import MessageStats, ResourceStats, Stats, Times, measure
from tca_tools.stats.text import stats_lines
from tca_tools.terminal import cut, line_width
from tca_wire.text.measures import counted
from tca_wire.text.printable import printable

_ENDS = ("failed", "killed", "dropped", "open")
_SHARES = (50, 90, 99)

SORTS: dict[str, Callable[[MessageStats], float]] = {
    "sent": lambda stats: stats.sent,
    "failed": lambda stats: stats.failed_runs,
    "start": lambda stats: _p99(stats.to_start),
    "handling": lambda stats: _p99(stats.handling),
    "end": lambda stats: _p99(stats.to_end),
    "queued": lambda stats: stats.queued.total,
    "busy": lambda stats: stats.handling.total,
}
"""The figures by which messages may be sorted, the largest first."""


@click.command()
@log_argument
@click.option("--from", "start", metavar="SECONDS", type=MOMENT, help="Only what was sent or begun from there on.")
@click.option("--to", "end", metavar="SECONDS", type=MOMENT, help="Only what was known then.")
@click.option(
    "--sort",
    type=click.Choice(["name", *SORTS]),
    default="sent",
    show_default=True,
    help="By number, by name, by failed runs; by the p99 of the three times; by all time queued, or handled.",
)
@click.option("--json", "as_json", is_flag=True, help="As JSON, with more figures; times in seconds.")
def stats(log_path: Path | None, start: float | None, end: float | None, sort: str, as_json: bool) -> None:
    """Count messages, and measure how long they took and waited.

    \b
    sent to start  from when a message was sent until its handler began
    runs failed    how often handlers failed, whatever became of that
    handling       how long handlers ran
    sent to end    until the sender had the answer, or the task was achieved;
                   the line below the table says what it is without
    busy           the share of a resource's slots that ran handlers, from the
                   first task to the end of the last (or from --from on)
    waiting        the share of that in which these waited themselves
    in the queue   waits for a slot, or a handler; open: those that go on,
                   which count until the end or now (+: at least so long)

    p50 and p99 are exact: half of the times, or 99 in 100, are no longer. LOG is a journal directory or one of its
    segments; without it, the newest run is measured.
    """  # noqa: D301 - click wants the character itself
    journal = open_log(log_path)
    history = folded(journal, end)
    check_span(start, history.time)
    measured = measure(history, start)
    messages = sorted(measured.messages, key=lambda one: one.name)
    if sort != "name":
        messages.sort(key=SORTS[sort], reverse=True)
    if as_json:
        click.echo(json.dumps(_plain(journal.name, measured, messages)))
    else:
        width = line_width()
        title = cut(_title(printable(journal.name), measured), width)
        click.echo("\n".join([title, *stats_lines(measured, messages, measured.resources, width)]))
    journal.check()


def _p99(times: Times) -> float:
    return times.percentile(99) or 0.0


def _title(name: str, measured: Stats) -> str:
    tasks = [stats for stats in measured.messages if stats.is_of_tasks]
    others = [stats for stats in measured.messages if not stats.is_of_tasks]
    said = [_sum(tasks, "task"), _sum(others, "other message" if tasks else "message")]
    still = " (still running)" * measured.is_live
    return (
        f"{name}: {measured.start:.2f} to {measured.end:.2f} s{still}, {', '.join(filter(None, said)) or '0 messages'}"
    )


def _sum(messages: list[MessageStats], what: str) -> str:
    """``8 tasks (1 failed, 2 open)``; "" if there are none."""
    news = [(sum(getattr(stats, ended) for stats in messages), ended) for ended in _ENDS]
    said = ", ".join(f"{number} {ended}" for number, ended in news if number)
    sent = sum(stats.sent for stats in messages)
    return f"{counted(sent, what)}{said and f' ({said})'}" if sent else ""


def _plain(name: str, measured: Stats, messages: list[MessageStats]) -> dict[str, Any]:
    return {
        "log": name,
        "from": measured.start,
        "to": measured.end,
        "live": measured.is_live,
        "busy_from": measured.busy_in[0],
        "busy_to": measured.busy_in[1],
        "deadlocks": measured.deadlocks,
        "messages": [_plain_message(stats, measured.seconds) for stats in messages],
        "resources": [_plain_resource(stats) for stats in measured.resources],
    }


def _plain_message(stats: MessageStats, seconds: float) -> dict[str, Any]:
    counts = ("sent", "direct", "handled", "failed_runs", "failed", "killed", "dropped", "open")
    return {
        "message": stats.name,
        "class": stats.message_class,
        **{name: getattr(stats, name) for name in counts},
        "rate": stats.sent / seconds if seconds else None,
        **{name: _plain_times(times) for name, times in stats.times().items()},
    }


def _plain_resource(stats: ResourceStats) -> dict[str, Any]:
    return {
        "module": stats.module,
        "resource": stats.resource,
        "capacity": stats.capacity,
        "handled": stats.handled,
        "busy": stats.busy.seconds,
        "busy_share": stats.busy.share,
        "waiting": stats.busy.waiting,
        "queued": _plain_times(stats.queued),
        "longest_queue": stats.longest_queue,
    }


def _plain_times(times: Times) -> dict[str, Any]:
    shares = {f"p{share}": times.percentile(share) for share in _SHARES}
    return {
        "count": len(times),
        "open": len(times.going_on),
        "total": times.total,
        **shares,
        "max": times.percentile(100),
    }


if __name__ == "__main__":
    stats(prog_name="python -m tca_tools.stats")

"""``tca stats``: the number of messages, their times, and the use of resources."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.options import TIME, check_span, log_argument
from tca_tools.stats.measure import MessageStats, ResourceStats, Stats, Times, measure
from tca_tools.stats.text import stats_lines
from tca_tools.terminal import line_width
from tca_wire.text.bodies import json_text
from tca_wire.text.printable import printable

SORTS: dict[str, Callable[[MessageStats], float]] = {
    "sent": lambda stats: stats.sent,
    "failed": lambda stats: stats.failed_runs,
    "start": lambda stats: stats.to_start.percentile(99) or 0.0,
    "handling": lambda stats: stats.handling.percentile(99) or 0.0,
    "end": lambda stats: stats.to_end.percentile(99) or 0.0,
    "queued": lambda stats: sum(stats.queued.seconds),
    "busy": lambda stats: sum(stats.handling.seconds),
}
"""By name of an order: its figure, which sorts messages from the largest on."""

_USE_KEYS = ("busy", "busy_share", "waiting")
"""The figures of a resource's use, in JSON."""


@click.command()
@log_argument
@click.option(
    "--from",
    "start",
    metavar="SECONDS",
    type=TIME,
    help="Count only what was sent or started since then.",
)
@click.option(
    "--to", "end", metavar="SECONDS", type=TIME, help="Count only what was known by then."
)
@click.option(
    "--sort",
    type=click.Choice(["name", *SORTS]),
    default="sent",
    show_default=True,
    help=(
        "Sort by name, messages sent, failed runs, the p99 of one of the three times, "
        "or the total time queued or handled (busy)."
    ),
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print JSON, with more figures; times in seconds."
)
def stats(
    log_path: Path | None, start: float | None, end: float | None, sort: str, as_json: bool
) -> None:
    """Count messages, and measure how long they took and waited.

    \b
    sent to start  from sending a message to the start of its handler
    runs failed    handlers that failed, even if the failure was dealt with
    handling       the durations of handlers
    sent to end    until the sender has the answer, or the task is achieved;
                   without killed, failed and dropped messages
    busy           the share of a resource's slots that ran handlers, from the
                   first task to the end of the last (or from --from on)
    waiting        the share of this time in which the handlers waited
    queued         waits for a slot or a handler; open: those that have not
                   ended, counted until the end or now (+: at least)

    p50 and p99 are exact: half of the times, or 99 in 100, are no longer.
    """  # noqa: D301 - click interprets the character itself
    journal = open_log(log_path)
    run = folded(journal, end)
    check_span(start, run.time)
    measured = measure(run, start)
    measured.messages.sort(key=lambda one: one.message)
    if sort != "name":
        measured.messages.sort(key=SORTS[sort], reverse=True)
    if as_json:
        click.echo(json_text(_plain(journal.name, measured)))
    else:
        lines = stats_lines(printable(journal.name), measured, line_width())
        click.echo("\n".join(lines))
    journal.check()


def _plain(name: str, measured: Stats) -> dict[str, Any]:
    seconds = measured.end - measured.start
    return {
        "log": name,
        "from": measured.start,
        "to": measured.end,
        "live": measured.is_live,
        "busy_from": measured.busy_in[0],
        "busy_to": measured.busy_in[1],
        "deadlocks": measured.deadlocks,
        "messages": [
            {**_row(stats), "rate": stats.sent / seconds if seconds else None}
            for stats in measured.messages
        ],
        "resources": [_row(stats) for stats in measured.resources],
    }


def _row(stats: MessageStats | ResourceStats) -> dict[str, Any]:
    """Return all fields of a message or resource."""
    row: dict[str, Any] = {}
    for name in stats.__slots__:
        value = getattr(stats, name)
        if name == "use":
            for key, figure in zip(_USE_KEYS, ("busy", "share", "waiting"), strict=True):
                row[key] = getattr(value, figure, 0.0)
        elif isinstance(value, Times):
            row[name] = _plain_times(value)
        else:
            row["class" if name == "message_class" else name] = value
    return row


def _plain_times(times: Times) -> dict[str, Any]:
    shares = {f"p{share}": times.percentile(share) for share in (50, 90, 99)}
    return {
        "count": len(times.seconds),
        "open": len(times.open_times),
        "total": sum(times.seconds),
        **shares,
        "max": times.percentile(100),
    }


if __name__ == "__main__":
    stats(prog_name="python -m tca_tools.stats")

"""The command: which cases to measure, how often, and where to write the figures."""

from pathlib import Path

import click
import msgspec

from dev.benchmarks.messages.cases import (
    MESSAGE_PEERS,
    ROBOT_BUS,
    STAGES,
    TASK_PEERS,
    chosen,
    quick_stages,
)
from dev.benchmarks.messages.results import report_of
from dev.benchmarks.messages.running import run
from dev.benchmarks.messages.table import lines

_PEERS = {entry.title for entry in (*MESSAGE_PEERS, ROBOT_BUS, *TASK_PEERS)}


@click.command()
@click.option(
    "--only",
    metavar="CASE",
    multiple=True,
    help="Only cases, or groups of cases, with this name (repeatable).",
)
@click.option(
    "--rounds",
    default=5,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of measurements of each case.",
)
@click.option(
    "--seconds",
    default=0.5,
    show_default=True,
    type=click.FloatRange(min=0, min_open=True),
    help="Duration for each contestant in each round.",
)
@click.option("--peers", is_flag=True, help="Measure other installed programs, too.")
@click.option(
    "--quick",
    is_flag=True,
    help="Send few messages, to see that all works. The figures mean nothing.",
)
@click.option(
    "--list",
    "listing",
    is_flag=True,
    help="List the cases and contestants, and measure nothing.",
)
@click.option(
    "--json",
    "path",
    metavar="FILE",
    type=click.Path(dir_okay=False, writable=True, path_type=Path),
    help="Write all figures.",
)
def bench(
    only: tuple[str, ...],
    rounds: int,
    seconds: float,
    path: Path | None,
    *,
    peers: bool,
    quick: bool,
    listing: bool,
) -> None:
    """Measure the costs of messages and tasks on this machine.

    Central runs beside zmq.proxy, the limit of what ZeroMQ allows, and with --peers beside NATS,
    Redis and others. All take turns in each round, so the ratios hold on a busy machine, too.
    Absolute figures hold for this machine only.
    """
    known = [
        name for stage in STAGES for name in (stage.title, *(case.name for case in stage.cases))
    ]
    if unknown := [name for name in only if name not in known]:
        raise click.UsageError(f"no case '{unknown[0]}': --list names them")
    if path and not path.parent.is_dir():
        raise click.UsageError(f"no folder '{path.parent}' for the figures: create it first")
    stages = chosen(
        quick_stages(STAGES) if quick else STAGES,
        lambda name: not only or name in only,
        lambda one: peers or one.title not in _PEERS,
    )
    if listing:
        for stage in stages:
            click.echo(f"{stage.title}: {', '.join(case.name for case in stage.cases)}")
            click.echo(f"    of {', '.join(entry.title for entry in stage.entries)}")
        return
    report = report_of(
        run(stages, rounds, seconds, lambda text: click.echo(text, err=True)), rounds, seconds
    )
    for line in lines(report):
        click.echo(line)
    if path:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(report)) + b"\n")

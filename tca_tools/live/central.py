"""``tca central``: the daemon, and with --stop the end of a running one."""

import math
import time
from typing import Any

import click

from tca_central.__main__ import central as daemon
from tca_central.replication.member import SILENT
from tca_module.sockets.place import accepts_connections
from tca_tools.errors import ToolError
from tca_tools.live.shared import talking

_ENDS_WITHIN = 10.0
"""Seconds that central has to end."""
_POLL_SECONDS = 0.01


def _run(*, stop: bool, keep: bool, **options: Any) -> None:
    """Run the daemon, or end a running one."""
    if not stop:
        if keep:
            raise click.UsageError(
                "--keep is for --stop: a new central continues a kept run anyway"
            )
        assert daemon.callback is not None
        daemon.callback(**options)
        return
    context = click.get_current_context()
    given = [
        parameter.opts[-1]
        for parameter in daemon.params
        if parameter.name not in ("bind", None)
        and context.get_parameter_source(str(parameter.name)) is _GIVEN
    ]
    if given:
        raise click.UsageError(f"leave {given[0]} out: with --stop only --bind and --keep count")
    _stop(options["bind"], keep=keep)


_GIVEN = click.core.ParameterSource.COMMANDLINE


def _stop(bind: str | None, *, keep: bool) -> None:
    """End the central at an address, and wait until it has ended. Raises ToolError."""
    with talking("central", bind) as client:
        address = client.address
        client.end_central(keep=keep)
    until = time.monotonic() + _ENDS_WITHIN
    while accepts_connections(address):
        if time.monotonic() > until:
            raise ToolError(
                f"central at {address} has not ended within {_ENDS_WITHIN:g} s: kill it"
            )
        time.sleep(_POLL_SECONDS)
    fate = "is kept, and continues when central starts again" if keep else "is over"
    click.echo(f"central at {address} has ended; its run {fate}")


central = click.Command(
    "central",
    callback=_run,
    params=[
        *daemon.params,
        click.Option(["--stop"], is_flag=True, help="End the central at --bind instead."),
        click.Option(
            ["--keep"],
            is_flag=True,
            help="With --stop: keep the run. It continues at the next start.",
        ),
    ],
    help=daemon.help,
)


def _stand_by(*, is_manual: bool, after: float, **options: Any) -> None:
    """Follow a leader, and take over."""
    if not options["log_address"]:
        raise click.UsageError("--log is missing: name the servers of the leader's log")
    assert daemon.callback is not None
    options |= _NOT_OF_STANDBYS
    daemon.callback(**options, is_standby=True, after=math.inf if is_manual else after)


_NOT_OF_STANDBYS = {"no_journal": False, "no_inputs": False, "if_fails": "stop", "fresh": False}
"""Options of central that make no sense for a standby, and their defaults."""


standby = click.Command(
    "standby",
    callback=_stand_by,
    params=[
        *(one for one in daemon.params if one.name not in _NOT_OF_STANDBYS),
        click.Option(
            ["--after"],
            type=click.FloatRange(min=SILENT),
            default=SILENT,
            show_default=True,
            metavar="SECONDS",
            help="Silence of the leader after which this central leads.",
        ),
        click.Option(
            ["--manual", "is_manual"],
            is_flag=True,
            help="Lead only if a person says so, by the signal SIGUSR2 to this process.",
        ),
    ],
    help="Follow the central that leads, and take over when it is silent.",
)

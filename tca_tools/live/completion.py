"""Shell completion of names from a running central. Without one nothing is completed."""

from collections.abc import Callable, Iterable

import click

from tca_module.client import Client, connect
from tca_module.errors import TcaError
from tca_tools.terminal import for_shell
from tca_wire.messages.notices import COMMANDS
from tca_wire.vocabulary import CENTRAL, MessageClass

_PATIENCE = 0.5
"""Seconds that the shell waits for central."""

Complete = Callable[[click.Context, click.Parameter, str], list[str]]


def from_central(names_in: Callable[[Client], Iterable[str]]) -> Complete:
    """Return a completion from the names that a function gets from central."""

    def complete(context: click.Context, _: click.Parameter, start: str) -> list[str]:
        address = context.params.get("central")
        try:
            with connect(f"{COMMANDS}completion", address, _PATIENCE) as client:
                return for_shell(names_in(client), start)
        except TcaError:
            return []

    return complete


def messages(*classes: MessageClass) -> Complete:
    """Return the completion of the names of declared messages of some classes."""
    return from_central(
        lambda client: [one.name for one in client.messages() if one.message_class in classes]
    )


MODULES = from_central(
    lambda client: [
        one.name for one in client.modules() if not one.name.startswith((COMMANDS, CENTRAL))
    ]
)
RESOURCES = from_central(
    lambda client: [resource.name for one in client.modules() for resource in one.resources]
)
QUERIES = MessageClass.QUERY, MessageClass.MULTI_QUERY
TASKS = MessageClass.GOAL, MessageClass.COMMAND
SENT = *QUERIES, *TASKS, MessageClass.INFORM, MessageClass.BROADCAST

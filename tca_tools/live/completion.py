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


def messages(is_wanted: Callable[[MessageClass], bool]) -> Complete:
    """Return the completion of the names of declared messages of the wanted classes."""
    return from_central(
        lambda client: [
            one.name for one in client.messages() if is_wanted(MessageClass(one.message_class))
        ]
    )


def is_query(one: MessageClass) -> bool:
    """Whether messages of a class are answered to their sender."""
    return one.asks_one or one.asks_many


def is_sent(one: MessageClass) -> bool:
    """Whether 'tca send' sends messages of a class."""
    return not (one.keeps_value or one.is_monitor or one.handles_failures)


MODULES = from_central(
    lambda client: [
        one.name for one in client.modules() if not one.name.startswith((COMMANDS, CENTRAL))
    ]
)
RESOURCES = from_central(
    lambda client: [resource.name for one in client.modules() for resource in one.resources]
)
TASKS = messages(lambda one: one.is_task and not one.is_monitor)

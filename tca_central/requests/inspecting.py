"""Modules ask about tasks, and what central knows of a topic."""

from typing import Any

import msgspec

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection
from tca_central.state import State
from tca_central.status import topics as status
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer
from tca_wire.points import ROOT
from tca_wire.vocabulary import Limit, Refusal


def on_inspect(central: State, connection: Connection, header: headers.Inspect, _: bytes) -> None:
    """A module asks about a task and its relatives."""
    task = central.tree.root if header.task == ROOT else central.tree.task(header.task)
    found = status.relatives(central, task or central.kept.get(header.task), header.relation, header.message)
    _answer(central, connection, header.number, found, f"the {header.relation} of task {header.task}")


def on_ask(central: State, connection: Connection, header: headers.Ask, _: bytes) -> None:
    """A module asks what central knows."""
    _answer(central, connection, header.number, status.TOPICS[header.topic](central), f"the answer to '{header.topic}'")


def _answer(central: State, connection: Connection, number: int, value: Any, what: str) -> None:
    body = msgspec.msgpack.encode(value)
    if len(body) > Limit.BODY:
        raise RequestError(Refusal.OVERLOAD, f"{what} has {len(body)} bytes: read the journal")
    central.send(connection, number, Answer(number), body)

"""Constraints are added between tasks that exist."""

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection
from tca_central.state import State
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.vocabulary import Refusal

MOST_CONSTRAINTS = 1000
"""In one request: so long must everybody else wait for it."""


def check_number(constraints: list[Constraint]) -> None:
    """Raises RequestError if there are too many for one request."""
    if len(constraints) > MOST_CONSTRAINTS:
        text = f"{len(constraints)} constraints in one request: {MOST_CONSTRAINTS} are allowed, send several requests"
        raise RequestError(Refusal.OVERLOAD, text)


def on_constrain(central: State, connection: Connection, header: headers.Constrain, _: bytes) -> None:
    """Constraints between tasks that exist."""
    check_number(header.constraints)
    added = central.agenda.constrain(header.constraints)
    if added:
        central.facts.append(facts.Constrained(added))
    central.accept(connection, header.number)

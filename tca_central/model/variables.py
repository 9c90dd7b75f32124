"""Shared variables: the newest value of each, as bytes. Knows nothing of who watches them."""

from typing import NamedTuple

from tca_central.errors import RequestError
from tca_wire.vocabulary import Refusal

VARIABLE_BYTES = 64 << 20
"""What the values of all variables may hold together. Their number is bounded by that of the messages."""


class Value(NamedTuple):
    """A variable's value, and the module that set it."""

    body: bytes
    format: str  #: of the variable then
    set_by: str  #: a module's name
    message_id: int  #: of the message that set it


class Variables:
    """The values that variables have; one that was never set has none. They outlive the module that set them."""

    def __init__(self) -> None:
        self.values: dict[str, Value] = {}
        self.bytes = 0  #: size of what they hold

    def check_room(self, name: str, body: bytes) -> None:
        """Raises RequestError if this value would be too much."""
        known = self.values.get(name)
        size = self.bytes + len(body) - (len(known.body) if known else 0)
        if size > VARIABLE_BYTES:
            text = f"with {len(body)} bytes in '{name}' all variables would hold {size}: {VARIABLE_BYTES} are allowed"
            raise RequestError(Refusal.OVERLOAD, text)

    def put(self, name: str, value: Value) -> None:
        """The newest value wins; ``check_room`` has passed."""
        self.forget(name)
        self.values[name] = value
        self.bytes += len(value.body)

    def forget(self, name: str) -> None:
        """Forget a variable's value."""
        if (known := self.values.pop(name, None)) is not None:
            self.bytes -= len(known.body)

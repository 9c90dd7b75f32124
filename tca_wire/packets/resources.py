"""The headers about locks, reservations and variables, which modules send. See headers.py."""

from tca_wire.packets.parts import Numbered


class Lock(Numbered, frozen=True, tag=23):
    """Lock a resource against all messages or (*reserve*) those of other modules.

    Answered when granted. The claim ends when this request is given up, when the task or message
    *origin* has ended, or with the connection.
    """

    resource: str
    module: str = ""
    """The resource's module; "" if only one module has a resource of that name."""
    reserve: bool = False
    origin: int = 0
    timeout: float = -1
    """Seconds to wait; then the answer is the failure "timeout" (negative: no limit)."""
    priority: int = 0
    blocking: bool = False
    """The sender's connection does nothing else until the answer arrives."""
    brief: bool = False
    """As in Send."""


class Unlock(Numbered, frozen=True, tag=24):
    """Take a lock or reservation from its holder. Accepted has id 0 if it had no holder."""

    resource: str
    module: str = ""
    origin: int = 0


class Release(Numbered, frozen=True, tag=28):
    """Release the claim of Lock *request*. Accepted has id 0 if the sender had lost it."""

    request: int
    origin: int = 0


class GetVariable(Numbered, frozen=True, tag=20):
    """Get a variable. The body of the Answer is its value, empty if it was never set."""

    variable: str


class SetVariable(Numbered, frozen=True, tag=21):
    """Set a variable to the value in the body.

    Answered by Accepted or, with *swap*, by the previous value, as for GetVariable.
    """

    variable: str
    origin: int = 0
    swap: bool = False

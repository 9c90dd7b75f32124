"""The headers of what central says to a module, one type a message; the field order is the wire order."""

import msgspec

from tca_wire.packets.parts import Tapped, Trouble, Watching
from tca_wire.packets.routes import EntranceGone, Route
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome, Refusal


class _Header(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What all headers share: an array on the wire, whose first element is the kind."""


class Welcome(_Header, frozen=True, tag=33):
    """Answers Hello. *module* is the name by which the journal knows the module; *epoch* names this run of central."""

    number: int
    version: int
    module: str
    epoch: str


class Accepted(_Header, frozen=True, tag=34):
    """The request was taken; *id* is the task or message it became (0: neither)."""

    number: int
    id: int = 0


class Refused(_Header, frozen=True, tag=35):
    """The request was not taken, and nothing of it remains."""

    number: int
    refusal: Refusal
    text: str


class Answer(_Header, frozen=True, tag=36):
    """The answer to a query, a wait or a question; the body is the reply, result or failure data."""

    number: int
    outcome: Outcome = Outcome.DONE
    failure: str = ""
    text: str = ""
    more: bool = False
    """Of a multi-query: further answers follow; the one without *more* is the end. It has no body and is *done*, or is
    the first failure where all who were asked failed: the first line of its text names them all."""


class Deliver(_Header, frozen=True, tag=37):
    """Handle this message and answer with Reply or Fail; the body is its data."""

    delivery: int
    message: str
    task: TaskId = TaskId(0)
    """The task that it is (0: it belongs to no tree)."""
    context: Trouble | Tapped | Watching | None = None
    """What it is about, where central made it."""
    suspended: bool = False
    own: bool = False
    """A slot of its resource waits for the answer, and this one takes messages directly: handle it within another."""


class Cancelled(_Header, frozen=True, tag=38):
    """The task of this delivery has been killed, or is to be handled again: its handler should end soon."""

    delivery: int
    why: str = ""
    """Why, and of a kill by whom."""


class Beat(_Header, frozen=True, tag=39):
    """Central is alive."""


class Unknown(_Header, frozen=True, tag=40):
    """Central does not know this connection: say Hello again, then repeat what is not acknowledged."""

    number: int = 0
    """Of the request that it answers, which is not done: whoever sent that only once knows that nobody has it."""


class Closing(_Header, frozen=True, tag=41):
    """Central ends."""

    text: str = ""


class Suspended(_Header, frozen=True, tag=42):
    """The task of this delivery has been suspended, or resumed: its handler may hold, or go on to its end."""

    delivery: int
    is_suspended: bool


class Taken(_Header, frozen=True, tag=43):
    """What the Lock with this number got was taken away: *text* says by whom, or why."""

    number: int
    text: str


ToModule = (
    Welcome | Accepted | Refused | Answer | Deliver | Cancelled | Beat | Unknown | Closing | Suspended | Taken | Route
    | EntranceGone
)  # fmt: skip

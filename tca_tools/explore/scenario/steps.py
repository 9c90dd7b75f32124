"""The next steps of a script, and the answers that it got to earlier ones: its run.

Tasks are named by their place in the script, not by central's ids, so that what a script does next
depends on nothing but its data and what it got: ``OWN`` is the task that it handles, ``known(0)``
the first other one that it heard of.
"""

from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

import msgspec

from tca_wire.messages.declarations import Message
from tca_wire.packets import headers
from tca_wire.packets.parts import Tapped, Trouble, Watching
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome, Refusal

OWN = TaskId(-2)
"""The task that a script handles."""

HERE = 1
"""The delivery that a script handles."""


def known(place: int) -> TaskId:
    """The name of the task, exception handler or wiretap that a script heard of as number *place*
    (0, 1, ...).
    """
    return TaskId(-3 - place)


def place_of(name: int) -> int:
    """The inverse of ``known``."""
    return -3 - name


class _Step(msgspec.Struct, frozen=True):
    @property
    def kind(self) -> str:
        """By which a script is held to doing the same each time."""
        return type(self).__name__


class Ask(_Step, frozen=True):
    """Send something to central; *declares* are the messages that central must know for it."""

    header: Any
    body: bytes = b""
    declares: tuple[Message[Any, Any], ...] = ()
    wants_answer: bool = False
    """The answer is awaited by itself: central's word that it was taken is not."""
    is_one_way: bool = False
    """Nothing comes back at all."""

    @property
    def kind(self) -> str:
        """The header and data of a request, as a text to compare."""
        return (
            f"{type(self.header).__name__} {crc32(msgspec.msgpack.encode(self.header) + self.body)}"
        )


class AwaitAnswer(_Step, frozen=True):
    """Wait for an answer to the request that was made as number *request*, for so many seconds if
    not for ever.
    """

    request: int
    seconds: float | None = None


class ReadClientRequest(_Step, frozen=True):
    """Read the next thing that a client wants of the script's task, if there is one; or wait for
    it, so many seconds if not for ever.
    """

    waits: bool = False
    seconds: float | None = None


class Abandon(_Step, frozen=True):
    """Want no answer to that request any more."""

    request: int


class NoticeKill(_Step, frozen=True):
    """See by an error that one's task was killed, if it was."""


class Return(_Step, frozen=True):
    """The script is over; of a handler, *body* is its reply or result."""

    body: bytes


class Fail(_Step, frozen=True):
    """The handler fails."""

    failure: str
    text: str = ""
    body: bytes = b""
    kinds: tuple[str, ...] = ()
    reissue: bool = False
    was_killed: bool = False
    """With TaskKilled or Stopped: if its own task was killed, too, that is no failure."""


class Hang(_Step, frozen=True):
    """The script never goes on."""


class OweReply(_Step, frozen=True):
    """The handler has returned, and its module keeps the reply that it owes until another script
    speaks of that.
    """


class UseKeptReplies(_Step, frozen=True):
    """Use the replies to *message* that the module keeps, or will: of handlers that have begun."""

    message: str
    words: str


Step = (
    Ask
    | AwaitAnswer
    | ReadClientRequest
    | Abandon
    | NoticeKill
    | Return
    | Fail
    | Hang
    | OweReply
    | UseKeptReplies
)


class StepResult(msgspec.Struct, frozen=True):
    """The result of a step of that kind, or the script's decision (*kind* "choose", ...:
    *choice*).
    """

    kind: str
    refusal: Refusal | None = None
    text: str = ""
    id: TaskId = TaskId(0)
    """The task or other thing that the request became."""
    answer: headers.Answer | None = None
    body: bytes = b""
    is_late: bool = False
    """The time was over."""
    is_woken: bool = False
    """It is not waited for any more: the task of whoever waits was killed, or its module ends."""
    module_ends: bool = False
    """The latter."""
    choice: int = 0
    words: str = ""
    """Of a choice: what was chosen; of a look: the transition of a client (its number is *choice*);
    of a kept reply:
    what another script says of it.
    """

    @property
    def is_over(self) -> bool:
        """Whether nothing more comes of the request."""
        return self.answer is None or not self.answer.more

    @property
    def is_void(self) -> bool:
        """Whether a kill has ended what was asked for: see Request of tca_module."""
        return self.refusal is Refusal.TOO_LATE or self.outcome is Outcome.KILLED

    @property
    def outcome(self) -> Outcome:
        """How what was asked for ended."""
        return self.answer.outcome if self.answer is not None else Outcome.DONE


History = tuple[StepResult, ...]


class HandlerInput(msgspec.Struct, frozen=True):
    """The input of a handler."""

    body: bytes
    is_task: bool = False
    accepts: bool = False
    """Its handler says itself when it accepts a task."""
    context: Trouble | Tapped | Watching | None = None


@dataclass(slots=True, eq=False)
class ScriptRun:
    """The input of a script and all that it has got since, the newest here. Equal lives are the
    same object, so that one more thing costs the same after however many.
    """

    given: HandlerInput
    number: int  #: no other run of the program has it
    before: "ScriptRun | None" = None
    got: StepResult | None = None
    branches: "tuple[Branch, ...] | None" = None  #: how it may go on, once that was asked
    _after: "dict[StepResult, ScriptRun]" = field(default_factory=dict)

    def extended(self, got: StepResult, number: int) -> "ScriptRun":
        """This run and one more thing; *number* is for one that was not lived before."""
        if got not in self._after:
            self._after[got] = ScriptRun(self.given, number, self, got)
        return self._after[got]

    def history(self) -> History:
        """All that it has got, oldest first."""
        found: list[StepResult] = []
        run: ScriptRun | None = self
        while run is not None and run.got is not None:
            found.append(run.got)
            run = run.before
        return tuple(reversed(found))


class Branch(msgspec.Struct, frozen=True):
    """One way in which a script may go on: what it decides, and then does."""

    decisions: History
    step: Step

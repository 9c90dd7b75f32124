"""The steps of a script and their results, which make up its run.

Scripts name tasks by their place in the script, not by central's ids. The next step of a script
therefore depends on nothing but its input and the results so far. ``OWN`` is the task that the
script handles; ``known(0)`` is the first other task that it learned of.
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
    """Return a script's name for the task, exception handler or wiretap at *place* (0, 1, ...)."""
    return TaskId(-3 - place)


def place_of(name: int) -> int:
    """Return the place of a name: the inverse of ``known``."""
    return -3 - name


class _Step(msgspec.Struct, frozen=True):
    @property
    def kind(self) -> str:
        """A text by which a script is checked to take the same steps in each run."""
        return type(self).__name__


class Ask(_Step, frozen=True):
    """Send a request to central; *declares* are the messages that central must know for it."""

    header: Any
    body: bytes = b""
    declares: tuple[Message[Any, Any], ...] = ()
    wants_answer: bool = False
    """Whether the answer is awaited with a step of its own; else central's reply ends this step."""
    is_one_way: bool = False
    """Whether central sends no reply at all."""

    @property
    def kind(self) -> str:
        """The header and a checksum of the request, as a text to compare."""
        return (
            f"{type(self.header).__name__} {crc32(msgspec.msgpack.encode(self.header) + self.body)}"
        )


class AwaitAnswer(_Step, frozen=True):
    """Wait for an answer to request number *request*, for *seconds*; None waits forever."""

    request: int
    seconds: float | None = None


class ReadClientRequest(_Step, frozen=True):
    """Read the next request of a client to the script's task, if there is one.

    With *waits*, wait for one, at most *seconds*; None waits forever.
    """

    waits: bool = False
    seconds: float | None = None


class Abandon(_Step, frozen=True):
    """Abandon a request, whose answers are no longer wanted."""

    request: int


class NoticeKill(_Step, frozen=True):
    """Learn by an error that the script's task was killed, if it was."""


class Return(_Step, frozen=True):
    """End the script; *body* is the reply or result of a handler."""

    body: bytes
    transition: str = ""
    """The transition by which a handler ends its task ("": the usual one)."""


class Fail(_Step, frozen=True):
    """End the handler with a failure."""

    failure: str
    text: str = ""
    body: bytes = b""
    kinds: tuple[str, ...] = ()
    reissue: bool = False
    was_killed: bool = False
    """Whether TaskKilled or Stopped ended the handler. That is no failure if its task was killed.
    """


class Hang(_Step, frozen=True):
    """Never continue."""


class OweReply(_Step, frozen=True):
    """Return from the handler but owe its reply, until another script uses ``UseKeptReplies``."""

    frees_slot: bool = False


class UseKeptReplies(_Step, frozen=True):
    """Use the replies that started handlers of *message* owe or will owe; *words* say how."""

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
    """The result of a step, or a decision of the script (*kind* "choose", ...)."""

    kind: str
    """The kind of the step or decision."""
    refusal: Refusal | None = None
    text: str = ""
    id: TaskId = TaskId(0)
    """The task or other object that the request created."""
    answer: headers.Answer | None = None
    body: bytes = b""
    is_late: bool = False
    """The wait timed out."""
    is_woken: bool = False
    """The wait was interrupted: the script's task was killed, or its module ends."""
    module_ends: bool = False
    """The wait was interrupted because the module ends."""
    choice: int = 0
    """The place of the chosen alternative; for a client's request, the number of its transition."""
    words: str = ""
    """The chosen alternative, a client's transition, or how another script uses an owed reply."""

    @property
    def is_over(self) -> bool:
        """Whether no further answer to the request follows."""
        return self.answer is None or not self.answer.more

    @property
    def is_void(self) -> bool:
        """Whether a kill has ended the request: see Request of tca_module."""
        return self.refusal is Refusal.TOO_LATE or self.outcome is Outcome.KILLED

    @property
    def outcome(self) -> Outcome:
        """The outcome of the request."""
        return self.answer.outcome if self.answer is not None else Outcome.DONE


History = tuple[StepResult, ...]


class HandlerInput(msgspec.Struct, frozen=True):
    """The input of a handler."""

    body: bytes
    is_task: bool = False
    accepts: bool = False
    """Whether the handler itself accepts the task, with ``accept()``."""
    context: Trouble | Tapped | Watching | None = None
    """The failure, tapped message or monitor that the delivery is about."""


@dataclass(slots=True, eq=False)
class ScriptRun:
    """The input of a script and its results so far, as a linked list with the newest here.

    Equal runs are the same object. Adding a result therefore takes the same time in a long run as
    in a short one.
    """

    given: HandlerInput
    number: int  #: unique among the runs of the program
    before: "ScriptRun | None" = None
    got: StepResult | None = None
    branches: "tuple[Branch, ...] | None" = None  #: the possible continuations, once computed
    _after: "dict[StepResult, ScriptRun]" = field(default_factory=dict)

    def extended(self, got: StepResult, number: int) -> "ScriptRun":
        """Return this run with one more result; a new object gets *number*."""
        if got not in self._after:
            self._after[got] = ScriptRun(self.given, number, self, got)
        return self._after[got]

    def history(self) -> History:
        """Return the results, oldest first."""
        found: list[StepResult] = []
        run: ScriptRun | None = self
        while run is not None and run.got is not None:
            found.append(run.got)
            run = run.before
        return tuple(reversed(found))


class Branch(msgspec.Struct, frozen=True):
    """One way in which a script may continue: its decisions, then its step."""

    decisions: History
    step: Step

"""The connection of a script to central, in place of the module library's.

A script is run again from its start whenever a step has a result. A call whose result is known
returns it. The first call without a result ends the run (``StepReached``). The state of a script is
therefore nothing but its input and its results, and these can be copied and compared. The calls of
a task are the library's own code. Only the connection below them is another one.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from types import SimpleNamespace
from typing import Any, NoReturn, cast

from tca_module.checks import check_message
from tca_module.errors import FormatRefused, Refused, Stopped, TaskKilled
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_module.sending.replies import QUERY_TIMEOUT
from tca_module.session.epoch_numbers import numbers_in
from tca_module.session.open_deliveries import OpenDelivery
from tca_module.session.request import Request
from tca_module.session.sent_tasks import SentId, TaskSends
from tca_tools.explore.errors import ScenarioError
from tca_tools.explore.scenario import steps
from tca_wire.messages.declarations import Message
from tca_wire.messages.large_data import inline
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState, Observe, Requested
from tca_wire.points import TaskId
from tca_wire.vocabulary import Refusal

CHOOSE, CANCELLED, SUSPENDED = "choose", "cancelled", "suspended"
"""The kinds of StepResult that are decisions of a script, made without central."""

MAX_CAUGHT = 10_000
"""The most times that a script may continue after the end of a run.

Code that cleans up continues a few times; a loop that catches every exception never ends.
"""

MAX_DECISIONS = 100
"""The most decisions between two steps. A script with more decisions is taken to run forever."""

_NOT_EXPLORED = {
    headers.Ask: "modules(), handlers() and status()",
    Observe: "observing",
    "listen": "to follow a task (state, changes(), progress(), update(); take() and cancel() are)",
    "is_lock_lost": "held",
    "wait_in_coroutine": "await",
    "wait_until": "sleep() and wait_until()",
    "callbacks": "query_notify()",
}


class StepReached(BaseException):
    """Ends a run at a step without a result. A script's ``except Exception`` does not catch it."""

    def __init__(self, step: steps.Step) -> None:
        super().__init__(step)
        self.step = step


class DecisionReached(BaseException):
    """Ends a run at a decision that is not made yet."""

    def __init__(self, decisions: Iterable[steps.StepResult]) -> None:
        super().__init__()
        self.decisions = tuple(decisions)


class ScriptRequest:
    """A request that a script has made, with the answers that it has read."""

    def __init__(self, link: "ScriptConnection", place: int) -> None:
        self.place = place
        self.answers: deque[tuple[headers.Answer, bytes]] = deque()
        self.accepted: int | None = None
        self.why_lock_lost = ""
        self.is_over = False
        self.epoch = ""  #: central never restarts here
        self._link = link

    @property
    def notify(self) -> None:
        """The function to call with an answer: not explored, so None."""

    @notify.setter
    def notify(self, _: object) -> None:
        self._link.refuse("query_notify()")


class ClientRequests:
    """The clients' requests to the task that a script handles; each is read with its own step."""

    def __init__(self, link: "ScriptConnection") -> None:
        self._link = link
        self._read: deque[tuple[Requested, bytes]] = deque()

    def __bool__(self) -> bool:
        if not self._read:
            self.read(steps.ReadClientRequest())
        return bool(self._read)

    def popleft(self) -> tuple[Requested, bytes]:
        """Remove and return the oldest request that was read."""
        return self._read.popleft()

    def read(self, step: steps.ReadClientRequest) -> steps.StepResult:
        """Take the step, and store the request that it reads."""
        got = self._link.do(step)
        if got.words:
            self._read.append((Requested(steps.HERE, got.words, got.choice, got.text), got.body))
        return got


class ScriptDelivery:
    """The delivery that a script handles, in place of the library's OpenDelivery."""

    def __init__(self, link: "ScriptConnection") -> None:
        self.requested = ClientRequests(link)
        self.on_request: list[Callable[[], None]] = []
        self.is_killed = self.is_cancelled = link.is_cancelled
        self._state: Any = None

    def state_of(self, _: int, make: Callable[[OpenDelivery], Any]) -> Any:
        """Return the state of the task, created by *make* when it is first needed."""
        self._state = self._state or make(cast("OpenDelivery", self))
        return self._state


class ScriptConnection:
    """One run of a script, up to its first step without a result."""

    def __init__(
        self,
        history: steps.History,
        on_caught: Callable[[ScenarioError | None], NoReturn] | None = None,
    ) -> None:
        # Central never restarts here, so no attachments are stored to be repeated.
        attachments = SimpleNamespace(find=lambda _: None)
        self.transport = SimpleNamespace(time=self.now, waker=lambda: None)
        self.delivery = ScriptDelivery(self)
        self.session = SimpleNamespace(
            epoch="", module="explored", attachments=attachments, open_deliveries=self.delivery
        )
        self.is_own_thread = True  #: a script has one thread
        self._all_declared: dict[str, Message[Any, Any]] = {}
        self.why_silent = ""  #: central is never silent here
        self.is_inherited = False  #: no script forks
        self.log = SimpleNamespace(error=lambda *_: None)  #: each run would log the error again
        self.kept: Any = None  #: the LaterReply given to ``keep_reply``, and its function
        #: A weak reference to the LaterReply that the handler returned.
        self.returned_reply: Callable[[], object] = lambda: None
        self._callbacks: deque[Callable[[], None]] = deque()
        #: Adds a function that ``run_requested_calls`` calls.
        self.call_soon = self._callbacks.append
        self.frees_slot = False  #: whether the slot handles other messages until the owed reply
        self._owed: Any = None  #: the reply that the handler owed, once the script has sent it
        #: The step or decision at which the run ended, or is about to end.
        self.stopped: StepReached | DecisionReached | None = None
        self.error: ScenarioError | None = None  #: the reason why the script can't be played
        self._on_caught = on_caught  #: called if the script continues forever after its end
        self._sends = TaskSends()
        self._history = history
        self._position = 0  #: in the history
        self._is_cancelled = False  #: whether the script knows that its task or module ends
        self._requests = 0
        self._caught = 0  #: the number of times that the script continued after its end
        self._declared: dict[str, Message[Any, Any]] = {}  #: since the last step

    def __getattr__(self, name: str) -> Any:
        if name in _NOT_EXPLORED:
            self.refuse(_NOT_EXPLORED[name])
        raise AttributeError(name)

    def refuse(self, call: str) -> NoReturn:
        """Fail: the explorer does not support *call*."""
        self.end(
            ScenarioError(
                f"{call} is not explored: leave it out of the scenario, or model what it does"
            )
        )

    # --- the run ----------------------------------------------------------------------------------

    def do(self, step: steps.Step) -> steps.StepResult:
        """Take a step; return its result, or end this run if it has no result yet."""
        self.run_requested_calls()
        if self._position < len(self._history):
            return self._recorded(step.kind)
        if self.stopped is None:
            self.stopped = StepReached(step)
        raise self._end_of_run()

    def decide(self, kind: str, alternatives: Sequence[str]) -> int:
        """Return the place of the chosen alternative; each is explored."""
        if self._position < len(self._history):
            got = self._recorded(kind)
            if got.choice >= len(alternatives) or alternatives[got.choice] != got.words:
                self._refuse_change()
            return got.choice
        if self.stopped is None:
            self.stopped = DecisionReached(
                steps.StepResult(kind, choice=i, words=words)
                for i, words in enumerate(alternatives)
            )
        raise self._end_of_run()

    def hang(self) -> NoReturn:
        """Wait forever."""
        self.do(steps.Hang())
        raise AssertionError

    def _recorded(self, kind: str) -> steps.StepResult:
        got = self._history[self._position]
        if got.kind != kind:
            self._refuse_change()
        self._position += 1
        return got

    def _refuse_change(self) -> NoReturn:
        self.end(
            ScenarioError(
                "it acts differently when it is run again: it may use nothing but its arguments"
            )
        )

    def end(self, error: ScenarioError) -> NoReturn:
        """End the script with *error*: it can't be played."""
        self.error = error
        self._check_caught()
        raise error

    def _end_of_run(self) -> StepReached | DecisionReached:
        """Return the exception that ends this run, again for each call of code that cleans up."""
        assert self.stopped is not None
        self._check_caught()
        return self.stopped

    def _check_caught(self) -> None:
        self._caught += 1
        if self._caught > MAX_CAUGHT and self._on_caught is not None:
            self._on_caught(self.error)

    # --- calls of the module library: see tca_module/link/connection.py -----------------------

    def has_declared(self, message: Message[Any, Any]) -> bool:
        """Return False: messages are declared with each step."""
        check_message(message)
        return False

    def declare(self, *messages: Message[Any, Any], within: float = 0.0) -> None:
        """Declare messages to central with the next step."""
        del within
        self._declared.update({message.name: message for message in messages})
        self._all_declared.update(self._declared)

    def declared(self, name: str) -> Message[Any, Any] | None:
        """Return the message of that name; None if the script has not declared it."""
        return self._all_declared.get(name)

    def catch_up(self) -> None:
        """Do nothing: steps read what has arrived."""

    def send_change(self, header: ChangeState, body: bytes, what: str) -> None:
        """Change the state of a task; central replies at once."""
        _accepted_result(self.do(self._ask(header, body)), what)

    def wait_for_client(self, seconds: float | None, what: str) -> None:
        """Wait for a client's request to the task."""
        got = self.delivery.requested.read(steps.ReadClientRequest(waits=True, seconds=seconds))
        if got.is_woken:
            self._raise_woken(got, what)

    # --- replies that are owed: see tca_module/sending/later_reply.py -----------------------------

    def check_process(self) -> None:
        """No script forks."""

    def run_requested_calls(self) -> None:
        """Call the functions added with ``call_soon``; each step does so first."""
        while self._callbacks:
            self._callbacks.popleft()()

    def store(self, body: bytes, _: object) -> bytes:
        """Return a body that holds its large data itself: a script shares no memory."""
        return inline(body)

    def opened(self, body: bytes) -> bytes:
        """Return the body: it holds its large data itself."""
        return body

    def reply(self, header: headers.Reply | headers.Fail, body: bytes) -> None:
        """Store the owed reply."""
        self._owed = header, body

    def postpone(self, header: headers.Postpone) -> None:
        """Store how the slot is used until the owed reply."""
        self.frees_slot = header.frees_slot

    def owed(self) -> tuple[headers.Reply | headers.Fail, bytes]:
        """Return the owed reply, once it is stored.

        A LaterReply without a reference is deleted, and reports its deletion with ``call_soon``.
        This happens at the same place of each run, because CPython deletes objects without
        references at once. A LaterReply that survives the frames of the script is refused. It has
        a reference from elsewhere, or is in a cycle of references that CPython may collect at any
        time.
        """
        self.run_requested_calls()
        if self._owed is None and self.kept is None and self.returned_reply() is not None:
            self.refuse("a LaterReply that is kept without keep_reply()")
        if self._owed is None:
            self._use(*(self.kept or self.hang()))
        return self._owed or self.owed()

    def _use(self, later: Any, then: Callable[[Any, str], object]) -> None:
        self.kept, got = None, self.do(steps.OweReply(self.frees_slot))
        later.module_ends() if got.module_ends else then(later, got.words)

    def call(self, header: Any, what: object, body: bytes = b"", within: float = 0) -> int:
        """Send a request to central; return the id of the object that it creates."""
        del within
        return _accepted_result(self.do(self._ask(header, body)), what).id

    def send_task(self, header: Any, body: bytes, what: str) -> TaskId:
        """Send a task; central replies at once. A refusal is raised by the script's next call."""
        got = self.do(self._ask(header, body))
        if got.refusal is None:
            return got.id
        request = Request(header, body, wants_answer=False)
        request.what, request.is_over = what, True
        request.refused = headers.Refused(0, got.refusal, got.text)
        self._sends.add(request)
        return TaskId(SentId(self, request))

    def wait_for_id(self, request: Request) -> NoReturn:
        """Raise the refusal of a sent task."""
        self._sends.discard(request)
        request.check(request.what)
        raise AssertionError

    def raise_refusals(self) -> None:
        """Raise the refusal of a task that the script sent before it returns or continues."""
        self._sends.check(0)
        self._sends.check(steps.HERE)

    def post(self, header: Any, body: bytes) -> None:
        """Send a header that has no answer."""
        self.do(self._ask(header, body, is_one_way=True))

    def request(
        self,
        header: Any,
        body: bytes = b"",
        *,
        wants_answer: bool = False,
        is_awaited: bool = False,
    ) -> ScriptRequest:
        """Send a request whose answer is awaited later."""
        del is_awaited
        if type(header) in _NOT_EXPLORED:
            self.refuse(_NOT_EXPLORED[type(header)])
        self.do(self._ask(header, body, wants_answer=wants_answer))
        self._requests += 1
        return ScriptRequest(self, self._requests - 1)

    def wait(
        self,
        request: ScriptRequest,
        timeout: float | None,
        what: str,
        is_over: Callable[[], bool] | None = None,
    ) -> bool:
        """Wait for an answer; return False if the wait timed out.

        The library's default timeouts count as endless.
        """
        seconds = None if timeout in (QUERY_TIMEOUT, ACKNOWLEDGED_WITHIN) else timeout
        if is_over is not None and seconds is not None:
            self.refuse("multi_query(timeout=...)")
        while not (request.is_over or (is_over is not None and is_over())):
            got = self.do(steps.AwaitAnswer(request.place, seconds))
            if got.is_woken:
                self._raise_woken(got, what, request)
            if _accepted_result(got, what).is_late:
                return False
            request.is_over = got.is_over
            if got.answer is None:
                request.accepted = got.id
            else:
                request.answers.append((got.answer, got.body))
        return True

    ask_central = Connection.ask_central

    def _raise_woken(
        self, got: steps.StepResult, what: str, request: ScriptRequest | None = None
    ) -> NoReturn:
        self._is_cancelled = True
        if request is not None:
            if got.answer is None and got.refusal is None:
                self.abandon(request)
            request.is_over = True
        why = f"{what} is given up"
        raise Stopped(f"its module ends: {why}") if got.module_ends else TaskKilled("its task", why)

    def mark_notified(self) -> None:
        """Tell the play that the script learns of its kill by an error."""
        self.do(steps.NoticeKill())

    def abandon(self, request: ScriptRequest) -> None:
        """Abandon a request, whose answers are no longer wanted."""
        if not request.is_over:
            request.is_over = True
            self.do(steps.Abandon(request.place))

    def abandon_late(self, request: ScriptRequest) -> str:
        """Abandon a request. The reason stays empty: its words would differ from run to run."""
        self.abandon(request)
        return ""

    def check_thread(self, *_: object) -> None:
        """Do nothing: a script has one thread."""

    def release(self, request: ScriptRequest, what: str, *, at_once: bool = False) -> bool:
        """Release the lock that a request has; return whether it was held until now."""
        del what, at_once
        request.why_lock_lost = self.do(steps.Abandon(request.place)).text
        return not request.why_lock_lost

    def is_cancelled(self, delivery: int) -> bool:
        """Whether the script must end, because its task was killed or its module ends.

        Once this is true, it remains true.
        """
        del delivery
        self._is_cancelled = self._is_cancelled or bool(
            self.decide(CANCELLED, ("not cancelled", "cancelled"))
        )
        return self._is_cancelled

    def is_suspended(self, delivery: int) -> bool:
        """Whether the script has received the suspension of its task."""
        del delivery
        return bool(self.decide(SUSPENDED, ("not suspended", "suspended")))

    def _check_sends(self, header: Any) -> None:
        self.raise_refusals()
        for number in numbers_in(header):
            if isinstance(number, SentId):
                number.check_nameable(self)

    def now(self) -> float:
        """Return 0: time does not pass for a script."""
        return 0.0

    def _ask(
        self, header: Any, body: bytes, *, wants_answer: bool = False, is_one_way: bool = False
    ) -> steps.Ask:
        self._check_sends(header)
        declares, self._declared = tuple(self._declared.values()), {}
        return steps.Ask(header, inline(body), declares, wants_answer, is_one_way)


def _accepted_result(got: steps.StepResult, what: object) -> steps.StepResult:
    if got.refusal is not None:
        raise (FormatRefused if got.refusal is Refusal.FORMAT else Refused)(
            str(what), got.refusal, got.text
        )
    return got

"""The programs of the town. Modules handle goals, commands, queries and failures. Users send
messages.
"""

from collections.abc import Callable
from typing import Any, cast

import msgspec
from simulation.options import Options
from simulation.outside import Outside
from simulation.threads import (
    Busy,
    Failing,
    Lost,
    Nap,
    Process,
    Program,
    Steps,
    Thread,
    Wait,
    Woken,
    Work,
)

from tca_module.session.request import Request
from tca_module.session.sent_tasks import SentId
from tca_wire.constraints import Constraint, Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, HandlerFormat, MessageFormat, Trouble, WatchOptions
from tca_wire.points import ROOT, THIS, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Outcome

INTEGER = '{"type":"integer"}'
encode = msgspec.msgpack.encode

WORDS = {
    "goal": ("walk", "step"),
    "command": ("move", "lift", "check", "halt"),
    "query": ("stance", "where"),
    "multi-query": ("health",),
    "inform": ("note",),
    "broadcast": ("pose",),
    "exception handler": ("recover", "replan"),
    "variable": ("mode",),
}
FORMATS = {
    name: MessageFormat(name, kind, INTEGER, INTEGER if kind.has_reply or kind.only_acts else "")
    for kind in MessageClass
    for name in WORDS.get(kind, ())
}
FORMATS["watch"] = MessageFormat(
    "watch", MessageClass.POLLING_MONITOR, INTEGER, "", ["where", "note"]
)
MODULES: dict[str, dict[str, tuple[str, ...]]] = {
    "planner": {"planning": ("walk", "step")},
    "legs": {"legs": ("move", "lift", "stance"), "diary": ("note",)},
    "eye": {"eye": ("where", "health", "pose")},
    "expert": {"mind": ("recover", "replan", "check", "halt"), "ear": ("health", "pose", "mode")},
}
"""The handled messages of each module, by resource."""
SLOTS = {"planning": 2}
USED = {
    "planner": ("move", "lift", "where", "note", "watch", "replan"),
    "legs": ("where",),
    "expert": ("move", "walk", "lift", "note"),
    "user": (
        "halt",
        "walk",
        "step",
        "move",
        "lift",
        "stance",
        "where",
        "health",
        "note",
        "pose",
        "mode",
        "replan",
    ),
}
"""The messages that each program sends, or names in attachments."""
FAILURES = ("slipped", "stumbled")


class SentTask:
    """A task that a program has sent."""

    def __init__(self, token: int, request: Request, node: Any) -> None:
        self.token, self.request, self.node = token, request, node


class Hands:
    """The actions of a program, in one of its threads."""

    def __init__(self, town: "TownProgram", work: Work) -> None:
        self.thread: Thread = work.thread
        self.session = work.session
        self.outside, self.options = town.outside, town.options
        self.dice = work.thread.clockwork.dice
        self.delivery = work.delivery
        self.origin: Any = work.delivery.delivery if work.delivery is not None else 0

    def has(self, feature: str) -> bool:
        """Whether this life has a feature, and a chance decides to use it now."""
        return feature in self.options.features and self.dice.random() < 0.4

    def task(self, message: str, above: int, **options: Any) -> SentTask:
        """Send a goal or command under the current task."""
        after: list[SentTask] = options.pop("after", [])
        delay: float = options.pop("delay", 0.0)
        outside, session = self.outside, self.session
        token = outside.sends(
            message,
            above,
            tuple(one.token for one in after),
            self.thread.now + delay if delay else 0.0,
        )
        constraints = [
            Constraint(Point(one.node, Moment.END_ACHIEVING), Point(THIS, Moment.START_ACHIEVING))
            for one in after
        ]
        if delay:
            constraints.append(
                Constraint(
                    Point(ROOT, Moment.START_ACHIEVING), Point(THIS, Moment.START_HANDLING), delay
                )
            )
        parent = self.delivery.task if self.delivery is not None else TaskId(0)
        header = headers.Send(
            0,
            message,
            parent,
            self.origin,
            options.pop("flags", Flags.NONE),
            constraints,
            **options,
        )
        if session.is_welcome and self.dice.random() < 0.7:
            request = session.send(header, encode(token), message)
        else:
            request = session.request(header, encode(token))
        sent = SentTask(token, request, SentId(cast("Any", self.thread), request))
        request.notify = lambda: self._note_acknowledgement(sent)
        self.thread.flush()
        return sent

    def _note_acknowledgement(self, sent: SentTask) -> None:
        if sent.request.accepted is not None:
            self.outside.acknowledged(sent.token, int(sent.request.accepted))

    def known(self, sent: SentTask) -> Steps:
        """Wait until central has acknowledged a task."""
        if not sent.request.is_over:
            try:
                yield sent.request
            except Woken:
                sent.request.is_over, sent.request.why_lost = True, "it was given up"
        if sent.request.accepted is None:
            raise Lost(sent.request)
        self._note_acknowledgement(sent)
        return None

    def result(self, sent: SentTask) -> Steps:
        """Wait for the end of a task, and report its outcome to the outside."""
        yield from self.known(sent)
        point = Point(TaskId(sent.request.accepted), Moment.END_ACHIEVING)  # type: ignore[arg-type]
        request = self.session.request(
            headers.AwaitPoint(0, point, self.origin, blocking=True), wants_answer=True
        )
        yield request
        answer, body = request.answers[-1]
        self.outside.answered(sent.token, answer.outcome, answer.failure, body)
        return None

    def ask(self, message: str, *, blocking: bool = True) -> tuple[int, Request]:
        """Ask a query or multi-query."""
        token = self.outside.sends(message)
        header = headers.Send(0, message, origin=self.origin, blocking=blocking, flags=Flags.NONE)
        request = self.session.request(header, encode(token), wants_answer=True)
        self.thread.flush()
        return token, request

    def answer(self, token: int, request: Request) -> Steps:
        """Wait for the answer to a query or multi-query."""
        if not request.is_over:
            yield request
        if request.has_failed:
            raise Lost(request)
        header, body = request.answers[-1]
        if self.outside.sent[token].message != "health":
            self.outside.answered(token, header.outcome, header.failure, body)
        return None

    def send_statement(self, message: str) -> None:
        """Send an inform or broadcast."""
        token = self.outside.sends(message, sender=self.session if message == "note" else None)
        self.session.post(
            headers.Send(0, message, origin=self.origin, flags=Flags.NONE), encode(token)
        )
        self.thread.flush()

    def do(self, header: Any, body: bytes = b"\x00", *, wants_answer: bool = False) -> Request:
        """Make a request."""
        return self.session.request(header, body, wants_answer=wants_answer)

    def passes(self) -> Busy | Nap:
        """Return a random duration, busy or listening."""
        seconds = self.dice.random() * self.options.slow
        return (
            Nap(seconds)
            if "later" in self.options.features and self.dice.random() < 0.3
            else Busy(seconds)
        )

    @property
    def fails(self) -> bool:
        return self.dice.random() < self.options.failures


class TownProgram(Program):
    """Any program of the town."""

    def __init__(self, name: str, options: Options, outside: Outside) -> None:
        self.name, self.options, self.outside = name, options, outside

    def begin(self, process: Process, work: Work) -> Steps:
        """Declare the messages, attach exception handlers, and open slots."""
        hands = Hands(self, work)
        session = work.session
        handled = MODULES[self.name]
        handlers = [
            HandlerFormat(name, resource) for resource, names in handled.items() for name in names
        ]
        formats = [
            FORMATS[name]
            for name in {
                **dict.fromkeys(one.message for one in handlers),
                **dict.fromkeys(USED.get(self.name, ())),
            }
        ]
        yield session.request(headers.Register(0, formats))
        session.add_declared(formats, [])
        if self.name == "expert":
            yield from self._attach(hands)
        yield session.request(headers.Register(0, [], handlers, is_ready=True))
        session.add_declared([], handlers, is_ready=True)
        for resource in handled:
            for _ in range(SLOTS.get(resource, 1)):
                process.open_slot(resource)
        return None

    def _attach(self, hands: Hands) -> Steps:
        if "recover" in self.options.features:
            for message in ("move", "walk"):
                yield hands.do(headers.Attach(0, Attachment("", "recover"), ROOT, message))
        if "tap" in self.options.features:
            yield hands.do(headers.Tap(0, Condition.BEFORE_HANDLING, "check", "move"))
            yield hands.do(headers.Tap(0, Condition.WHEN_KILLED, "note", "lift"))
        return None

    def handle(self, work: Work, header: headers.Deliver, body: bytes) -> Steps:
        """Handle a message."""
        hands = Hands(self, work)
        steps: Callable[..., Steps] = _HANDLERS.get(header.message, _acts)
        token = self.outside.deliveries.get(header.delivery)
        return steps(hands, header, token)

    # --- handlers ---------------------------------------------------------------------------------


def _token(hands: Hands, header: headers.Deliver) -> int:
    return hands.outside.deliveries[header.delivery].token


def _acts(hands: Hands, header: headers.Deliver, _: Any) -> Steps:
    """Handle a command, which takes time and may fail."""
    yield hands.passes()
    if header.message == "move" and hands.has("many"):
        yield from hands.answer(*hands.ask("where"))
    if hands.fails:
        raise Failing(hands.dice.choice(FAILURES))
    return encode(1000 + header.delivery)


def _answers(hands: Hands, header: headers.Deliver, _: Any) -> Steps:
    if hands.dice.random() < 0.3:
        yield hands.passes()
    if header.message == "stance" and hands.dice.random() < 0.2:
        yield from hands.answer(*hands.ask("where"))
    if hands.fails:
        raise Failing("handler error")
    return encode(1000 + header.delivery)


def _hears(hands: Hands, header: headers.Deliver, _: Any) -> Steps:
    if hands.dice.random() < 0.2:
        yield hands.passes()
    return None


def _plans(hands: Hands, header: headers.Deliver, _: Any) -> Steps:
    """Handle a goal: send subtasks in some order, and wait for some of them."""
    token = _token(hands, header)
    dice, before = hands.dice, []  # type: ignore[var-annotated]
    for _number in range(dice.choice((1, 2, 3))):
        message = (
            "step"
            if header.message == "walk" and dice.random() < 0.3
            else dice.choice(("move", "lift"))
        )
        options = _options(hands)
        if dice.random() < 0.5:
            options["flags"] = Flags.SEQ_ACH | (
                Flags.DELAY_PLANNING if dice.random() < 0.3 else Flags.NONE
            )
        else:
            options["after"] = before[-1:]
        sent = hands.task(message, token, **options)
        before.append(sent)
        if dice.random() < 0.2:
            yield hands.passes()
        if dice.random() < 0.2 and message != "step":
            try:
                yield from hands.result(sent)
            except Lost:
                before.pop()
        if dice.random() < 0.2:
            yield from hands.answer(*hands.ask("where"))
    if hands.has("lock"):
        yield from _locks(hands)
    if hands.has("monitor"):
        watch = WatchOptions(0.5, 3, duration=4.0)
        hands.do(headers.Send(0, "watch", header.task, hands.origin, Flags.NONE, watch=watch))
    if hands.fails:
        raise Failing(dice.choice(FAILURES))
    return None


def _options(hands: Hands) -> dict[str, Any]:
    options: dict[str, Any] = {}
    if hands.has("deadline"):
        options["deadline"] = 1.0 + 4 * hands.dice.random()
    if hands.has("recover"):
        options["attachments"] = [Attachment(hands.dice.choice(FAILURES), "replan", 2)]
    if hands.has("keep"):
        options["keep"] = True
    if hands.dice.random() < 0.1:
        options["delay"] = hands.dice.random()
    if hands.dice.random() < 0.2:
        options["priority"] = 1
    return options


def _locks(hands: Hands) -> Steps:
    """Lock a resource of another module for a while."""
    request = hands.do(
        headers.Lock(
            0,
            "eye",
            "eye",
            origin=hands.origin,
            timeout=2.0,
            blocking=True,
            reserve=hands.dice.random() < 0.3,
        ),
        wants_answer=True,
    )
    try:
        yield request
    except Lost:
        return None
    if request.answers[-1][0].outcome is Outcome.DONE:
        yield Nap(hands.dice.choice((hands.options.slow, 5.0)))
        if not request.why_lock_lost:
            hands.outside.holds(hands.thread, "eye", hands.origin, 1.0 + 3 * hands.options.delay)
        yield hands.do(headers.Release(0, request.header.number, hands.origin))
    return None


def _recovers(hands: Hands, header: headers.Deliver, _: Any) -> Steps:
    """Handle a failure: retry, reissue, fail, or do nothing."""
    trouble, dice = header.context, hands.dice
    assert isinstance(trouble, Trouble)
    yield hands.passes()
    what = dice.random()
    if what < 0.5 and trouble.attempts < 4:
        task = int(trouble.failing.task)
        hands.outside.retries(task)
        try:
            yield hands.do(headers.Retry(0, TaskId(task), origin=hands.origin))
        except Lost:
            return None
    elif what < 0.7:
        raise Failing("slipped", reissue=True)
    elif what < 0.8:
        raise Failing("handler error")
    return None


_HANDLERS: dict[str, Callable[..., Steps]] = {
    "walk": _plans,
    "step": _plans,
    "stance": _answers,
    "where": _answers,
    "health": _answers,
    "note": _hears,
    "pose": _hears,
    "mode": _hears,
    "recover": _recovers,
    "replan": _recovers,
}


# --- users ----------------------------------------------------------------------------------------


class User(TownProgram):
    """A program that sends messages and waits for their outcomes."""

    def __init__(self, name: str, options: Options, outside: Outside) -> None:
        super().__init__(name, options, outside)
        self.left = options.actions
        self.open: list[SentTask] = []

    def begin(self, process: Process, work: Work) -> Steps:
        hands, dice = Hands(self, work), work.thread.clockwork.dice
        session = work.session
        known = [
            sent for sent in self.open if sent.request.accepted is not None
        ]  # of an earlier run, which crashed
        self.open = [
            SentTask(sent.token, sent.request, TaskId(int(sent.request.accepted or 0)))
            for sent in known
        ]
        formats = [FORMATS[name] for name in USED["user"]]
        yield session.request(headers.Register(0, formats))
        session.add_declared(formats, [])
        while self.left > 0:
            self.left -= 1
            try:
                yield from _ACTIONS[dice.choice(_NAMES)](self, hands)
            except (Lost, Woken) as error:
                work.thread.clockwork.trace(work.thread.name, f"user: {error}")
            yield Nap(dice.random() * 0.5)
        for sent in self.open:
            yield from self._waits(hands, sent)
        return None

    def _waits(self, hands: Hands, sent: SentTask) -> Steps:
        for _ in range(1000):
            try:
                yield from hands.result(sent)
            except (Lost, Woken) as error:
                hands.thread.clockwork.trace(hands.thread.name, f"user: {error}")
                if isinstance(error, Lost):
                    return None
            else:
                return None
        return None

    def _command(self, hands: Hands) -> Steps:
        sent = hands.task(hands.dice.choice(("move", "lift")), 0, **_options(hands))
        if hands.dice.random() < 0.5:
            yield from self._waits(hands, sent)
        else:
            self.open.append(sent)

    def _goal(self, hands: Hands) -> Steps:
        options = _options(hands)
        if self.open and hands.dice.random() < 0.5:
            options["after"] = [hands.dice.choice(self.open)]
        sent = hands.task(hands.dice.choice(("walk", "step")), 0, **options)
        if hands.dice.random() < 0.3:
            yield from self._waits(hands, sent)
        else:
            self.open.append(sent)

    def _query(self, hands: Hands) -> Steps:
        yield from hands.answer(*hands.ask(hands.dice.choice(("where", "stance"))))

    def _gives_up(self, hands: Hands) -> Steps:
        """Send a query, and give it up after a moment."""
        _, request = hands.ask("where")
        yield Wait(request, hands.dice.random() * 0.2)

    def _steers(self, hands: Hands) -> Steps:
        """Constrain, await, kill or time known tasks."""
        known = [sent for sent in self.open if sent.request.accepted is not None]
        if len(known) < 2:
            return
        one, other = hands.dice.sample(known, 2)
        first, second = (TaskId(int(sent.request.accepted or 0)) for sent in (one, other))
        what = hands.dice.choice(("constrain", "moment", "deadline", "kill after", "when killed"))
        if what == "constrain":
            yield hands.do(
                headers.Constrain(
                    0,
                    [
                        Constraint(
                            Point(first, Moment.END_ACHIEVING),
                            Point(second, Moment.START_ACHIEVING),
                        )
                    ],
                )
            )
            hands.outside.orders(one.token, other.token)
        elif what == "moment":
            moment = Point(first, hands.dice.choice(list(Moment)))
            yield hands.do(headers.AwaitPoint(0, moment, blocking=True), wants_answer=True)
        elif what == "deadline":
            yield hands.do(headers.Deadline(0, Point(first, Moment.END_ACHIEVING), 2.0))
        elif what == "kill after":
            yield hands.do(
                headers.Kill(
                    0, first, "planned", after=Point(second, Moment.END_ACHIEVING), delay=0.1
                )
            )
        else:
            yield hands.do(headers.Send(0, "halt", first, flags=Flags.NONE, when_killed=True))

    def _queries(self, hands: Hands) -> Steps:
        asked = [hands.ask("where", blocking=False) for _ in range(3)]
        yield Nap(0.05)
        for token, request in asked:
            yield from hands.answer(token, request)

    def _multi_query(self, hands: Hands) -> Steps:
        yield from hands.answer(*hands.ask("health"))

    def _informs(self, hands: Hands) -> Steps:
        for _ in range(hands.dice.choice((1, 3, 12)) if hands.has("informs") else 1):
            hands.send_statement("note")
        yield Nap(0.0)

    def _broadcast(self, hands: Hands) -> Steps:
        hands.send_statement("pose")
        yield Nap(0.0)

    def _lock(self, hands: Hands) -> Steps:
        if "lock" in hands.options.features:
            yield from _locks(hands)

    def _kill(self, hands: Hands) -> Steps:
        if self.open and hands.has("kill"):
            sent = hands.dice.choice(self.open)
            yield from hands.known(sent)
            yield hands.do(headers.Kill(0, TaskId(sent.request.accepted), "enough"))  # type: ignore[arg-type]

    def _suspend(self, hands: Hands) -> Steps:
        if self.open and hands.has("suspend"):
            sent = hands.dice.choice(self.open)
            yield from hands.known(sent)
            task = TaskId(sent.request.accepted)  # type: ignore[arg-type]
            yield hands.do(headers.Suspend(0, task))
            yield Nap(hands.dice.random())
            yield hands.do(headers.Suspend(0, task, resume=True))

    def _variable(self, hands: Hands) -> Steps:
        if hands.has("variable"):
            token = hands.outside.sends("mode")
            is_swapped = hands.dice.random() < 0.5
            header = headers.SetVariable(0, "mode", swap=is_swapped)
            yield hands.do(header, encode(token), wants_answer=is_swapped)


class Janitor(TownProgram):
    """A program that resumes the tasks that crashed users have suspended. If central holds tasks
    after a restart, the janitor lets them start.
    """

    def __init__(
        self, options: Options, outside: Outside, suspended: Callable[[], list[TaskId]]
    ) -> None:
        super().__init__("janitor", options, outside)
        self.suspended = suspended

    def begin(self, process: Process, work: Work) -> Steps:
        hands = Hands(self, work)
        yield hands.do(headers.Register(0, []))
        if self.options.hold:
            yield hands.do(headers.GoOn(0))
        for task in self.suspended():
            yield hands.do(headers.Suspend(0, task, resume=True))
        return None


_ACTIONS: dict[str, Callable[[User, Hands], Steps]] = {
    "command": User._command,
    "goal": User._goal,
    "query": User._query,
    "gives up": User._gives_up,
    "steers": User._steers,
    "queries": User._queries,
    "multi-query": User._multi_query,
    "informs": User._informs,
    "broadcast": User._broadcast,
    "lock": User._lock,
    "kill": User._kill,
    "suspend": User._suspend,
    "variable": User._variable,
}
_NAMES = ["command"] * 3 + ["goal"] * 4 + list(_ACTIONS)

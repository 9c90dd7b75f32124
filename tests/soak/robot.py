"""A robot that does everything there is, again and again, against the pure core: twenty seconds of its time a round."""

import sys
from collections import deque
from typing import Any

from central.player import ANY, Player, before, point, reachable

from tca_central.core import Central
from tca_central.events import ConnectionId, ConnectionLost, Event, RequestReceived, Tick, Transmit
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, HandlerFormat, MessageFormat, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Scope

ROUND = 20.0
"""Seconds."""

ROUNDS_AN_HOUR = 180

MODULES = {
    "planner": ("goal walk", "goal step"),
    "legs": ("command move", "command halt", "command adjust", "query stance"),
    "eye": ("query seen", "multi-query health", "broadcast pose"),
    "expert": ("exception handler recover", "command check"),
    "keeper": ("command stand",),
    "recorder": (
        "inform note",
        "variable mode",
        "broadcast pose",
        "multi-query health",
        "broadcast tca: module joined",
    ),
}
MONITORS = {
    "look": ("point monitor", ["seen", "adjust"]),
    "watch": ("polling monitor", ["seen", "note"]),
    "guard": ("demon monitor", ["", "note", "note"]),
}
FALSE, TRUE, DATA = b"\xc2", b"\xc3", b"\x07"


class Robot:
    """Central, five modules with two threads each, and a user who has them walk."""

    def __init__(self) -> None:
        self.central = Central()
        self.time, self.number, self.born, self.rounds = 0.0, 0, 0, 0
        self.nested_in = 0  # the round of the newest walk that has one under it
        self.inbox: deque[tuple[str, headers.Deliver]] = deque()
        self.connections: dict[str, list[str]] = {}
        self.waiting: list[tuple[str, headers.Deliver]] = []  # moves that are not answered at once
        self.hello("user")
        messages = [Player.format(words) for handled in MODULES.values() for words in handled]
        monitors = [MessageFormat(name, MessageClass(kind), ANY, "", parts) for name, (kind, parts) in MONITORS.items()]
        self.ask("user", headers.Register, [*messages[:-1], *monitors])
        for module in MODULES:
            self.join(module)
        self.ask("user", headers.Attach, Attachment("", "recover", 0), TaskId(0), "move")
        self.ask("user", headers.Tap, Condition.BEFORE_HANDLING, "check", "move")
        self.ask("user", headers.Tap, Condition.WHEN_KILLED, "note", "walk")
        self.ask("user", headers.Tap, Condition.WHILE_ACHIEVING, "watch", "step", watch=WatchOptions(period=3.0))
        keeper = self.connections["keeper"][0]
        self.standing = self.ask(keeper, headers.Send, "stand", TaskId(0))  # goes on all the time
        self.handle_all()

    @property
    def is_busy(self) -> bool:
        """Whether there are tasks but the one that goes on."""
        return len(self.central.tree.tasks) > 1

    # --- talking to central ------------------------------------------------------------------------------------

    def event(self, event: Event) -> list[Any]:
        """Let central have it; what it says to those who are not handlers."""
        effects = self.central.handle(event)
        told = [(effect.connection.decode(), effect.header) for effect in effects if isinstance(effect, Transmit)]
        self.inbox += ((to, header) for to, header in told if isinstance(header, headers.Deliver))
        return [header for _, header in told if not isinstance(header, headers.Deliver)]

    def receive(self, connection: str, header: Any, body: bytes = DATA) -> list[Any]:
        return self.event(RequestReceived(self.time, ConnectionId(connection.encode()), header, body))

    def ask(self, connection: str, kind: type, *fields: Any, body: bytes = DATA, **options: Any) -> int:
        """A request; the id of what came of it."""
        self.number += 1
        answers = self.receive(connection, kind(self.number, *fields, **options), body)
        refused = [answer for answer in answers if isinstance(answer, headers.Refused)]
        assert not refused, refused
        return max((answer.id for answer in answers if isinstance(answer, headers.Accepted)), default=0)

    def hello(self, module: str, resource: str = "") -> str:
        """A new connection, which has never been there before."""
        self.born += 1
        connection = f"{module}.{self.born}" if module != "user" else module
        mine = self.connections.setdefault(module, [])
        incarnation = f"{mine[0] if mine else connection}"
        mine.append(connection)
        self.ask(
            connection, headers.Hello, headers.PROTOCOL_VERSION, module, incarnation, len(mine) - 1, resource, "here:1"
        )
        return connection

    def join(self, module: str) -> None:
        connection = self.hello(module)
        messages = [Player.format(words) for words in MODULES[module]]
        handlers = [HandlerFormat(message.name, module, "", 5) for message in messages]
        self.ask(connection, headers.Register, messages, handlers)
        for _ in range(2):
            self.hello(module, module)
        self.handle_all()

    def lose(self, module: str) -> None:
        """A module dies with all that it has under way."""
        for connection in self.connections.pop(module):
            self.event(ConnectionLost(self.time, ConnectionId(connection.encode())))
        alive = {connection for mine in self.connections.values() for connection in mine}
        self.inbox = deque(item for item in self.inbox if item[0] in alive)
        self.waiting = [item for item in self.waiting if item[0] in alive]

    def send(self, message: str, under: int = 0, flags: Flags = Flags.SEQ_ACH, **options: Any) -> int:
        return self.ask("user", headers.Send, message, TaskId(under), under, flags, **options)

    def let_pass(self, seconds: float) -> None:
        """Time passes: central is told whenever something is due, and handlers return at once."""
        end = self.time + seconds
        while (due := self.central.clock.next) is not None and due <= end:
            self.time = max(self.time, due)
            self.event(Tick(self.time))
            self.handle_all()
        self.time = end
        self.event(Tick(end))
        self.handle_all()

    # --- what its handlers do --------------------------------------------------------------------------------------

    def handle_all(self) -> None:
        while self.inbox:
            connection, header = self.inbox.popleft()
            if header.message == "walk":
                self.walk(header.task)
            if header.message == "stand":
                continue
            if header.message in ("move", "step"):
                self.waiting.append((connection, header))
            elif header.message == "recover":
                self.recover(connection, header)
            else:
                self.receive(connection, headers.Reply(header.delivery), TRUE if self.rounds % 2 else FALSE)

    def walk(self, task: TaskId) -> None:
        """All that may stand under a goal."""
        step = self.send("step", task)
        self.send("watch", task, Flags.NONE, watch=WatchOptions(period=2.0))
        self.send("look", task, Flags.NONE)
        self.send("halt", task, when_killed=True)
        move = self.send("move", step, deadline=5.0, attachments=[Attachment("slip", "recover", 2)])
        delayed = before(point(move, Moment.END_ACHIEVING), point(-1, Moment.START_ACHIEVING), 1.5)
        second = self.send("move", step, constraints=[delayed], priority=2)
        self.ask(
            "user", headers.Constrain, [before(point(move, Moment.START_HANDLING), point(second, Moment.END_HANDLING))]
        )
        self.ask("user", headers.Tap, Condition.WHEN_ACHIEVED, "check", "", TaskId(step))
        self.ask("user", headers.Deadline, point(task, Moment.END_ACHIEVING), 8.0)
        is_nested = self.rounds % 6 == 5 and self.nested_in < self.rounds
        self.nested_in = self.rounds
        self.send("walk" if is_nested else "adjust", step, Flags.SEQ_ACH | Flags.PLAN_FIRST)

    def recover(self, connection: str, header: headers.Deliver) -> None:
        """Retry what slipped once, reissue what was lost, resolve the rest."""
        trouble: Any = header.context
        failing = trouble.failing.task
        if trouble.failure == "slip" and trouble.attempts == 1:
            self.ask(connection, headers.Retry, failing, new_data=True)
        if trouble.failure == "module lost":
            self.receive(connection, headers.Fail(header.delivery, "", reissue=True))
        else:
            self.ask(connection, headers.Resolve, origin=header.delivery)
            self.receive(connection, headers.Reply(header.delivery))

    def return_from_moves(self, failure: str = "") -> None:
        """The moves and steps under way return, or fail."""
        waiting, self.waiting = self.waiting, []
        for connection, header in waiting:
            if failure and header.message == "move":
                self.receive(connection, headers.Fail(header.delivery, failure))
            else:
                self.receive(connection, headers.Reply(header.delivery))
        self.handle_all()

    # --- a round ---------------------------------------------------------------------------------------------------

    def round(self) -> None:
        """Twenty seconds in which a walk is begun, and comes to some end."""
        self.rounds += 1
        end, kind = self.time + ROUND, self.rounds
        walk = self.send("walk")
        guard = self.send("guard", walk, watch=WatchOptions(fire_every=2))
        self.ask("user", headers.AwaitPoint, point(walk, Moment.END_ACHIEVING))
        self.handle_all()
        self.talk()
        for _ in range(2):
            self.ask("user", headers.Fire, TaskId(guard))
        if kind % 3 == 0:
            self.ask("user", headers.EndMonitor, TaskId(guard))
        if kind % 5 == 0:
            self.ask("user", headers.Suspend, TaskId(walk))
            self.let_pass(0.5)
            self.ask("user", headers.Suspend, TaskId(walk), resume=True)
        self.let_pass(6.0 if kind % 13 == 0 else 1.0)
        self.return_from_moves({0: "slip", 1: "fall"}.get(kind % 4, ""))
        if kind % 7 == 0:
            self.ask("user", headers.Kill, TaskId(walk), "enough", delay=1.0)
        if kind % 11 == 0 and walk in self.central.tree.tasks:
            self.ask("user", headers.Raise, TaskId(walk), "fatal")
        while self.is_busy and self.time < end + 60:
            self.let_pass(1.0)
            self.return_from_moves()
        self.let_pass(max(0.0, end - self.time))

    def talk(self) -> None:
        """Everything beside tasks; what is asked for in vain is given up."""
        self.ask("user", headers.SetVariable, "mode", body=b"\xcd%c%c" % (self.rounds // 256 % 256, self.rounds % 256))
        self.ask("user", headers.GetVariable, "mode")
        for message in ("stance", "note", "pose", "health", "note", "note"):
            self.send(message)
        self.send("stance")
        self.receive("user", headers.GiveUp(self.number))
        self.ask("user", headers.WaitUntilHandled, ["stance", "walk"])
        tap = self.ask("user", headers.Tap, Condition.AFTER_REPLIED, "note", "stance")
        attached = self.ask("user", headers.Attach, Attachment("slip", "recover"), TaskId(0))
        self.handle_all()
        for aside in (tap, attached):
            self.ask("user", headers.Remove, aside)
        self.lean_on_what_goes_on()

    def lean_on_what_goes_on(self) -> None:
        """What hangs on the end of a task that does not end, and is itself over soon."""
        end = point(self.standing, Moment.END_ACHIEVING)
        adjust = self.send("adjust", flags=Flags.NONE)
        self.ask("user", headers.Kill, TaskId(adjust), after=end)
        self.ask("user", headers.Kill, TaskId(self.standing), scope=Scope.DESCENDANTS, delay=1.0)
        behind = self.send("adjust", flags=Flags.NONE, constraints=[before(end, point(-1, Moment.START_ACHIEVING))])
        delayed = before(point(0, Moment.START_ACHIEVING), point(-1, Moment.START_ACHIEVING), 1e6)
        waiting = self.send("adjust", flags=Flags.NONE, constraints=[delayed], deadline=1e6)
        guard = self.send("guard", flags=Flags.NONE, watch=WatchOptions(duration=1e6, until=end))
        for task in (behind, waiting, guard):
            self.ask("user", headers.Kill, TaskId(task))
        self.ask("user", headers.Suspend, TaskId(waiting))  # too late
        self.handle_all()

    def restart(self, module: str) -> None:
        """A module dies in the middle of a walk, and returns."""
        self.send("walk")
        self.handle_all()
        self.lose(module)
        self.handle_all()
        self.let_pass(1.0)
        self.join(module)
        while self.is_busy:
            self.let_pass(1.0)
            self.return_from_moves()

    def live(self, hours: int, restart_after: int) -> None:
        """Rounds for so many hours; after every so many of them two modules die and return."""
        begun = self.rounds
        while self.rounds - begun < hours * ROUNDS_AN_HOUR:
            self.round()
            if self.rounds % restart_after == 0:
                self.restart("legs")
                self.restart(("planner", "eye", "expert", "recorder")[self.rounds // restart_after % 4])


def size_of(central: Central) -> tuple[int, int]:
    """How many objects central holds, everything that can be reached from it but code; and how many bytes they are."""
    count = size = 0
    for one in reachable(central):
        count += 1
        size += sys.getsizeof(one)
    return count, size

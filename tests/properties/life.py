"""Random lives: numbers become things that a module could do now."""

from central.player import Player, before, point
from hypothesis import strategies as st

from tca_central.core import Central
from tca_wire import headers
from tca_wire.constraints import Flags
from tca_wire.facts import Delivered, Received
from tca_wire.notices import HANDLERS_CHANGED, MODULE_JOINED, MODULE_LEFT
from tca_wire.points import Moment, TaskId

MODULES = {
    "planner": ("goal walk", "goal step", "query where", f"broadcast {HANDLERS_CHANGED.name}"),
    "legs": ("command move", "command lift", "inform note", f"broadcast {MODULE_LEFT.name}"),
    "map": ("query where", "multi-query all", "broadcast pose", "variable mode", f"broadcast {MODULE_JOINED.name}"),
}
MESSAGES = [message for handled in MODULES.values() for message in handled] + ["command later"]
small = st.integers(0, 1000)
operation = st.tuples(st.sampled_from(["send"] * 8 + ["reply"] * 8 + ["fail", "kill", "constrain", "wait", "lose",
                                       "join", "bye", "give up", "set", "await"]), small, small, small, small)  # fmt: skip


class Life:
    """Turns numbers into something that a module could do now."""

    def __init__(self) -> None:
        self.player = Player()
        self.generation = 0
        self.player.module("user")
        self.player.declare("user", *MESSAGES)
        for module in MODULES:
            self.join(module)

    @property
    def central(self) -> Central:
        return self.player.central

    def connections(self) -> list[str]:
        return [connection.decode() for connection in self.central.registry.connections]

    def join(self, module: str) -> None:
        self.generation += 1
        name = f"{module}{self.generation}"
        pending = (2, 0, 3, 1)[self.generation % 4]
        self.player.module(name, *MODULES[module], capacity=2, pool="all" if module == "map" else "", pending=pending)

    def copies_of(self, message: str) -> set[int]:
        """The deliveries of a message that goes to many."""
        sent = {fact.id for fact in self.player.facts(Received) if fact.message == message}
        return {fact.id for fact in self.player.facts(Delivered) if fact.message_id in sent}

    def do(self, name: str, a: int, b: int, c: int, d: int) -> None:
        getattr(self, f"{name.replace(' ', '_')}_")(a, b, c, d)

    def send_(self, a: int, b: int, c: int, d: int) -> None:
        senders = self.connections()
        tasks = [0, *self.central.tree.tasks]
        constraints = []
        if d % 4 == 0 and len(tasks) > 2:
            one, moment = tasks[1:][c % (len(tasks) - 1)], list(Moment)[d % 6]
            pair = [point(one, moment), point(-1, list(Moment)[a % 6])]
            constraints.append(before(*pair) if b % 2 else before(*reversed(pair)))
        self.player.send(
            senders[a % len(senders)], MESSAGES[b % len(MESSAGES)].split(" ", 1)[1], under=tasks[c % len(tasks)],
            flags=Flags(d % 16), constraints=tuple(constraints), priority=d % 3, maximum=d % 3, if_handled=a % 5 == 0,
        )  # fmt: skip

    def reply_(self, a: int, *_: int) -> None:
        attended = list(self.central.dispatcher.attended.values())
        if attended:
            delivery = attended[a % len(attended)]
            assert delivery.slot
            self.player.reply(delivery.slot.id.decode(), delivery.id, value=a)

    def fail_(self, a: int, *_: int) -> None:
        attended = list(self.central.dispatcher.attended.values())
        if attended:
            delivery = attended[a % len(attended)]
            assert delivery.slot
            self.player.fail(delivery.slot.id.decode(), "slipped", delivery.id)

    def kill_(self, a: int, *_: int) -> None:
        tasks = list(self.central.tree.tasks)
        if tasks:
            self.player.receive("user", headers.Kill(self.player.number("user"), TaskId(tasks[a % len(tasks)])))

    def constrain_(self, a: int, b: int, c: int, d: int) -> None:
        tasks = list(self.central.tree.tasks)
        if tasks:
            one, other = tasks[a % len(tasks)], tasks[b % len(tasks)]
            wanted = before(point(one, list(Moment)[c % 6]), point(other, list(Moment)[d % 6]))
            self.player.receive("user", headers.Constrain(self.player.number("user"), [wanted]))

    def wait_(self, a: int, b: int, c: int, d: int) -> None:
        tasks = list(self.central.tree.tasks)
        if tasks:
            where = point(tasks[a % len(tasks)], list(Moment)[b % 6])
            self.player.receive("user", headers.WaitFor(self.player.number("user"), where))

    def set_(self, a: int, b: int, c: int, *_: int) -> None:
        senders = self.connections()
        sender = senders[a % len(senders)]
        if c % 4:
            self.player.set_variable(sender, "mode", b, swap=c % 2 == 0)
        else:
            self.player.receive(sender, headers.GetVariable(self.player.number(sender), "mode"))

    def await_(self, a: int, b: int, c: int, *_: int) -> None:
        names = [MESSAGES[number % len(MESSAGES)].split(" ", 1)[1] for number in (a, b)]
        senders = self.connections()
        sender = senders[c % len(senders)]
        self.player.receive(sender, headers.WaitUntilHandled(self.player.number(sender), names))

    def give_up_(self, a: int, *_: int) -> None:
        self.player.receive("user", headers.GiveUp(1 + a % self.player.numbers["user"]))

    def lose_(self, a: int, *_: int) -> None:
        others = [name for name in self.connections() if name != "user"]
        if others:
            self.player.lose(others[a % len(others)])

    def bye_(self, a: int, *_: int) -> None:
        others = [name for name in self.connections() if name != "user"]
        if others:
            self.player.receive(others[a % len(others)], headers.Bye())

    def join_(self, a: int, *_: int) -> None:
        self.join(list(MODULES)[a % 3])

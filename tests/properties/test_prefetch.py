"""A slot that has messages ahead of the one that it handles: every run is one that could have happened without."""

import random
from collections import deque
from collections.abc import Iterator
from typing import Any

import pytest
from central.player import Player
from central.test_oracle import NO_SMALLER_SEED, JudgedLife, JudgedPlayer
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import operation
from tools.runs import OPENED, checked

from tca_central.core import Central
from tca_central.events import ConnectionId, Effect, RequestReceived, Tick
from tca_central.invariants import check_invariants
from tca_central.model.deliveries import Connection, Delivery
from tca_central.order import ahead
from tca_module.session.session import Session
from tca_tools.check import rules
from tca_wire.journal.facts import Delivered, Returned
from tca_wire.packets import headers
from tca_wire.packets.parts import EndedRun, HandlerFormat


@pytest.fixture(autouse=True, scope="module")
def every_handler_is_quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ahead, "QUICK", float("inf"))
        patch.setattr(ahead, "QUICK_RUNS", 0)
        yield


HANDLERS_CHANGE = headers.Hello | headers.Register | headers.Unregister | headers.Bye


class ToldLate:
    """Shows what slots get when their turn comes, as if they had nothing ahead."""

    def __init__(self, central: Central) -> None:
        self.central = central
        self.recalled: list[Connection] = []
        self.most = self.recalls = 0

    def deliver(self, delivery: Delivery, slot: Connection, *, is_there: bool) -> None:
        del is_there
        self.central.deliver(delivery, slot, is_there=False)

    def send_ahead(self, _: Delivery, slot: Connection) -> None:
        assert slot.resource is not None
        self.most = max(self.most, len(slot.resource.ahead))

    def recall(self, slot: Connection) -> None:
        self.recalls += 1
        self.recalled.append(slot)


class PrefetchPlayer(JudgedPlayer):
    """Each slot takes messages ahead, and gives back at once what is recalled: the oracle, which knows nothing of that,
    finds everything as ever.
    """

    prefetch = 3

    def __init__(self) -> None:
        super().__init__()
        dispatcher = self.central.dispatcher
        self.out = dispatcher._out = dispatcher.messages_ahead._out = ToldLate(self.central)
        self.joined = 0

    def _judged(self, event: Any) -> list[Effect]:
        effects = []
        if isinstance(event, RequestReceived) and isinstance(event.header, headers.Reply):
            event = self._together(event, event.header)
        for slot in list(self.central.registry.connections.values()):
            if self._gives_back_before(event, slot):
                effects += self._give_back(slot, event.time)
        effects += self.central.handle(event)
        while self.out.recalled:
            effects += self._give_back(self.out.recalled.pop(), event.time)
        check_invariants(self.central)
        self.note(effects)
        self.oracle.judge(event, effects)
        return effects

    def _together(self, event: RequestReceived, header: headers.Reply) -> RequestReceived:
        """The slot has handled some of what it has ahead, too, and says all at once."""
        slot = self.central.registry.connections[event.connection]
        others = list(slot.resource.ahead)[: round(event.time) % 3] if slot.resource is not None else []
        if not others or slot.resource.is_recalling or len(slot.handling) > 1:  # type: ignore[union-attr]
            return event
        self.joined += len(others)
        numbers = [header.delivery, *(one.given_as for one in others)]
        runs = [EndedRun(one, 0.1 * ago, 0.1, len(event.body)) for ago, one in enumerate(reversed(numbers))]
        return RequestReceived(event.time, event.connection, headers.Replies(runs[::-1]), event.body * len(runs))

    @staticmethod
    def _gives_back_before(event: Any, slot: Connection) -> bool:
        """Whether what a slot has ahead would come too late if it gave that back later: when it claims something itself,
        and when handlers come or go.
        """
        if slot.resource is None or not slot.resource.ahead or isinstance(event, Tick):
            return False
        is_own = isinstance(event, RequestReceived) and event.connection == slot.id
        if isinstance(event, RequestReceived) and not isinstance(event.header, HANDLERS_CHANGE):
            return is_own and isinstance(event.header, headers.Lock)
        return True

    def _give_back(self, slot: Connection, time: float) -> list[Effect]:
        unbegun = [one.given_as for one in slot.resource.ahead] if slot.resource is not None else []
        event = RequestReceived(time, slot.id, headers.Recalled(unbegun))
        effects: list[Effect] = []
        self.central._receive(event, effects)  # timers that are due have an event of their own
        return effects


class PrefetchLife(JudgedLife):
    """Most of what is sent may be ahead, and is sent to few."""

    player_class = PrefetchPlayer

    def join(self, module: str) -> None:
        self.generation += 1
        pool = "all" if self.generation % 5 == 0 else ""
        self.player.module(f"{module}{self.generation}", *self.modules[module], pool=pool)

    def sent_name(self, b: int) -> str:
        return super().sent_name(b) if b % 4 == 0 else ("note", "pose", "all", "where")[b // 4 % 4]

    def join_(self, a: int, *others: int) -> None:
        if len(self.connections()) < 10:
            super().join_(a, *others)


@given(st.lists(operation, max_size=60))
@settings(max_examples=12)
def test_the_oracle_sees_no_difference_in_short_lives(operations: list[tuple[str, int, int, int, int]]) -> None:
    life = PrefetchLife()
    for name, *numbers in operations:
        life.do(name, *numbers)


@given(st.integers(0, 1 << 32))
@settings(max_examples=4, phases=NO_SMALLER_SEED)
def test_the_oracle_sees_no_difference_in_lives_of_hundreds_of_events(seed: int) -> None:
    PrefetchLife().go_on(seed, 400)


@pytest.mark.soak
@given(st.integers(0, 1 << 32))
@settings(max_examples=200, phases=NO_SMALLER_SEED)
def test_the_oracle_sees_no_difference_in_many_lives(seed: int) -> None:
    PrefetchLife().go_on(seed, 2000)


def test_in_these_lives_messages_are_ahead_and_are_recalled_and_replies_are_joined() -> None:
    most = recalls = joined = 0
    for seed in range(30):
        if most > 1 and recalls and joined:
            return
        life = PrefetchLife()
        life.go_on(seed, 400)
        assert isinstance(life.player, PrefetchPlayer)
        most, recalls = max(most, life.player.out.most), recalls + life.player.out.recalls
        joined += life.player.joined
    pytest.fail(f"at most {most} were ahead, {recalls} recalls, {joined} replies joined: these lives test nothing")


# --- packets take their time -----------------------------------------------------------------------------------------


class Worker:
    """A slot of the library's own session, with packets under way in both directions. In a turn it holds its replies;
    its connection may break, and its process may be killed.
    """

    prefetch = 6

    def __init__(self, town: "Town", name: str) -> None:
        self.town, self.name = town, name
        town.player.hello(name)
        town.player.receive(name, headers.Register(town.player.number(name), [*FORMATS], HANDLERS))
        self.session = Session(
            headers.Hello(0, headers.PROTOCOL_VERSION, name, f"run of {name}", 1, "it", prefetch=self.prefetch)
        )
        self.to_central: deque[tuple[Any, bytes]] = deque()
        self.from_central: deque[tuple[Any, bytes]] = deque()
        self.handling = self.breaks = 0
        self.connect()

    def connect(self) -> None:
        self.to_central.clear()
        self.from_central.clear()
        self.slot = ConnectionId(f"{self.name}/1/{self.breaks}".encode())
        self.session.tend(self.now, self.now)
        self.post()

    def reconnect(self) -> None:
        """All that is under way is lost."""
        self.breaks += 1
        self.session.break_off()
        self.connect()

    @property
    def now(self) -> float:
        return self.town.player.time

    def post(self) -> None:
        """What the session says is on its way, in order."""
        self.to_central.extend(self.session.take_outgoing(self.now))

    def listen(self) -> None:
        if self.from_central:
            self.session.receive(*self.from_central.popleft(), self.now)
            self.post()

    def begin(self) -> None:
        """Begin with the next message, as a slot does that handles nothing."""
        waiting = self.session.deliveries or self.session.ahead
        if not self.handling and waiting:
            self.handling = waiting.popleft()[0].delivery
            self.session.held.begin(self.handling, self.now)
            self.town.begins(self, self.handling)

    def end(self) -> None:
        if self.handling:
            self.town.ends(self.handling)
            if not self.session.reply(headers.Reply(self.handling, 1.0), b"\x07", self.now):
                self.post()
            self.handling = 0


FORMATS = [Player.format(words) for words in ("query ask", "inform note", "broadcast all")]
HANDLERS = [HandlerFormat(message.name, "it", "") for message in FORMATS]


class Town:
    """Workers of one program, and those who send to it, give up and lock it; who comes last gets what waits."""

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)
        self.player = Player()
        self.begun: dict[int, str] = {}  #: by delivery, the worker that has begun it
        self.times: dict[int, list[float]] = {}  #: and when it was begun, and ended
        self.workers: list[Worker] = []
        self.killed: list[str] = []
        self.player.module("user")
        self.work()

    def work(self) -> None:
        if len(self.workers) < 3:
            self.workers.append(Worker(self, f"worker{len(self.workers) + len(self.killed)}"))

    def begins(self, worker: Worker, delivery: int) -> None:
        assert delivery not in self.begun, f"{delivery} is begun twice"
        self.begun[delivery], self.times[delivery] = worker.name, [worker.now]
        held_by = self.player.central.registry.modules[f"run of {worker.name}"].resources["it"].held_by
        assert held_by is None, f"{delivery} is begun while others have the resource"

    def ends(self, delivery: int) -> None:
        self.times[delivery].append(self.player.time)

    def kill(self, worker: Worker) -> None:
        """Its process ends. Central hears what it has sent, then that it is gone."""
        if len(self.workers) > 1:
            self.workers.remove(worker)
            self.killed.append(worker.name)
            while worker.to_central:
                self.hear(worker)
            for connection in (worker.slot.decode(), worker.name):
                self.player.lose(connection)

    def step(self) -> None:
        player, dice = self.player, self.dice
        worker = dice.choice(self.workers)
        what = dice.choice(["send"] * 7 + ["hear"] * 6 + ["listen"] * 6 + ["begin"] * 7 + ["end"] * 7 + ["post"]
                           + ["lock", "unlock", "give up", "work", "rare"])  # fmt: skip
        if what == "send":
            player.send("user", dice.choice(FORMATS).name, priority=dice.choice((0, 0, 0, 1)))
        elif what == "hear" and worker.to_central:
            self.hear(worker)
        elif what in ("listen", "begin", "end", "post"):
            getattr(worker, what)()
        elif what == "rare" and dice.random() < 0.5:
            self.kill(worker) if dice.random() < 0.2 else worker.reconnect()
        elif what == "lock":
            number = player.number("user")
            player.receive("user", headers.Lock(number, "it", worker.name, timeout=-1, priority=dice.choice((0, 1))))
        elif what in ("unlock", "give up"):
            central = player.central
            due = central.registry.connections[ConnectionId(b"user")].outstanding
            asked = [number for number, one in due.items() if isinstance(one, Delivery)]
            if numbers := [number for _, number in central.claims] if what == "unlock" else asked:
                player.receive("user", headers.GiveUp(dice.choice(numbers)))
        elif what == "work" and dice.random() < 0.2:
            self.work()

    def hear(self, worker: Worker) -> None:
        """Central gets the next thing from a worker."""
        header, body = worker.to_central.popleft()
        self.player.receive(worker.slot.decode(), header, body)

    def deliver(self) -> None:
        """What central has said is on its way."""
        for worker in self.workers:
            said = self.player.inbox.get(worker.slot.decode(), [])
            worker.from_central.extend(said)
            said.clear()

    def finish(self) -> None:
        """Let all that is under way come to its end."""
        for _, number in list(self.player.central.claims):
            self.player.receive("user", headers.GiveUp(number))
        for _ in range(200):
            self.deliver()
            for worker in self.workers:
                worker.begin()
                worker.end()
                worker.post()
                worker.listen()
                while worker.to_central:
                    self.hear(worker)


def check_times(town: Town) -> None:
    """Runs of one worker follow each other, and lie where they were but for the time that packets took."""
    over: dict[str, float] = {}
    for entry in town.player.entries:
        for fact in entry.facts:
            if isinstance(fact, Delivered):
                assert over.get(fact.module, 0.0) <= (fact.began or entry.time) <= entry.time
                assert not fact.began or fact.began >= town.times[fact.id][0]
                over[fact.module] = fact.began or entry.time
            elif isinstance(fact, Returned):
                name, ended = town.begun[fact.id], fact.ended or entry.time
                assert max(over[name], town.times[fact.id][1]) <= ended <= entry.time
                over[name] = ended


def live(seed: int, steps: int) -> Town:
    town = Town(seed)
    for _ in range(steps):
        town.step()
        town.deliver()
    town.finish()
    central = town.player.central
    assert not central.dispatcher.running
    assert not central.registry.connections[ConnectionId(b"user")].outstanding
    assert [
        name for module in central.registry.modules.values() for name, one in module.resources.items() if one.waiting
    ] == []
    given: dict[str, list[int]] = {name: [] for name in town.begun.values()}
    for fact in town.player.facts(Delivered):
        given.setdefault(fact.module, []).append(fact.id)
    for name, deliveries in given.items():
        mine = [delivery for delivery, by in town.begun.items() if by == name]
        known = mine[: len(deliveries)] if name in town.killed else mine
        assert known == deliveries[: len(known)], "begun in another order than central says"
        assert len(mine) - len(known) <= Worker.prefetch
        assert len(known) == len(deliveries) or name in town.killed
    check_times(town)
    # Until a slot has said what it had not begun nobody gets the resource, which the journal does not say.
    assert [one for one in checked([OPENED, *town.player.entries]) if one.rule != rules.FREE.text] == []
    return town


@given(st.integers(0, 1 << 32))
@settings(max_examples=15, phases=NO_SMALLER_SEED)
def test_what_is_recalled_is_not_begun_and_all_else_is_in_order(seed: int) -> None:
    live(seed, 250)


@pytest.mark.soak
@given(st.integers(0, 1 << 32))
@settings(max_examples=500, phases=NO_SMALLER_SEED)
def test_what_is_recalled_is_not_begun_in_many_lives(seed: int) -> None:
    live(seed, 1000)

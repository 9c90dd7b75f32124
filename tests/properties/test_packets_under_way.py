"""Slots of the library's own session with prefetched messages. Packets are delayed or lost, and
processes end. Each message starts once and in order, and the journal has the right times.
"""

import random
from collections import deque
from typing import Any

from central.player import Player
from central.test_oracle import NO_SMALLER_SEED
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.test_prefetch import every_handler_is_quick  # noqa: F401
from sampling import lives
from tools.runs import OPENED, checked

from tca_central.events import ConnectionId
from tca_central.model.deliveries import Delivery
from tca_module.session.request import Request
from tca_module.session.session import Session
from tca_tools.explain.graph import blocking_waits, next_node
from tca_tools.explain.waits import waits_of
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_tools.view.feed import Feed
from tca_wire.journal.facts import Delivered, Returned
from tca_wire.packets import headers
from tca_wire.packets.parts import HandlerFormat


class Worker:
    """A slot of the library's own session, with delayed packets in both directions. During a turn
    the slot holds its replies back. The slot's connection may break, and its process may be killed.
    """

    prefetch = 6

    def __init__(self, town: "Town", name: str) -> None:
        self.town, self.name = town, name
        town.player.hello(name)
        town.player.request(name, headers.Register, [*FORMATS], HANDLERS)
        self.session = Session(
            headers.Hello(
                0, headers.PROTOCOL_VERSION, name, f"run of {name}", 1, "it", prefetch=self.prefetch
            )
        )
        self.to_central: deque[tuple[Any, bytes]] = deque()
        self.from_central: deque[tuple[Any, bytes]] = deque()
        self.handling = self.breaks = 0
        self.locking: Request | None = None
        self.connect()

    def connect(self) -> None:
        self.to_central.clear()
        self.from_central.clear()
        self.slot = ConnectionId(f"{self.name}/1/{self.breaks}".encode())
        self.session.send_due(self.now, self.now)
        self.post()

    def reconnect(self) -> None:
        """Reconnect; all packets under way are lost."""
        self.breaks += 1
        self.session.break_off()
        self.connect()

    @property
    def now(self) -> float:
        return self.town.player.time

    @property
    def is_busy(self) -> bool:
        session = self.session
        has_packets = self.from_central or self.to_central or session.outgoing
        return bool(has_packets or session.deliveries or session.prefetched or self.locking)

    def post(self) -> None:
        """Take the outgoing packets of the session, in order."""
        self.to_central.extend(self.session.pop_outgoing(lambda: self.now))

    def listen(self) -> None:
        if self.from_central:
            self.session.receive(*self.from_central.popleft(), self.now)
            self.post()

    def begin(self) -> None:
        """Start the next message in a free slot. Prefetched messages wait while a callback claims a
        lock.
        """
        waiting = self.session.deliveries or (
            None if self.session.is_claiming else self.session.prefetched
        )
        if not self.handling and waiting:
            self.handling = waiting.popleft()[0].delivery
            self.session.held_replies.begin(self.handling, self.now)
            self.town.begins(self, self.handling)

    def lock(self) -> None:
        """Let a callback in a free slot lock the slot's own resource, or release this lock."""
        if self.locking is not None and self.locking.is_over:
            self.session.request(headers.Release(0, self.locking.header.number))
            self.locking = None
        elif self.locking is None and not self.handling:
            self.locking = self.session.request(headers.Lock(0, "it", self.name), wants_answer=True)
        self.post()

    def end(self) -> None:
        if self.handling:
            self.town.ends(self.handling)
            if not self.session.reply(headers.Reply(self.handling, 1.0), b"\x07", self.now):
                self.post()
            self.handling = 0


FORMATS = [Player.format(words) for words in ("query ask", "inform note", "broadcast all")]
HANDLERS = [HandlerFormat(message.name, "it", "") for message in FORMATS]


class Town:
    """Workers of one program, and users that send messages, give up and lock. The newest worker
    gets the queued messages.
    """

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)
        self.player = Player()
        self.begun: dict[int, str] = {}  #: by delivery, its worker
        self.times: dict[int, list[float]] = {}  #: by delivery, its start and end
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
        held_by = (
            self.player.central.registry.modules[f"run of {worker.name}"].resources["it"].held_by
        )
        is_own = held_by is not None and held_by.slot.module.called == worker.name
        assert held_by is None or is_own, f"{delivery} is begun while another module has the lock"

    def ends(self, delivery: int) -> None:
        self.times[delivery].append(self.player.time)

    def kill(self, worker: Worker) -> None:
        """End the worker's process. Central receives the packets that the worker has sent, then
        loses its connections.
        """
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
        operation = dice.choice(
            ["send"] * 7
            + ["hear"] * 6
            + ["listen"] * 6
            + ["begin"] * 7
            + ["end"] * 7
            + ["post"]
            + ["lock", "unlock", "own lock", "give up", "work", "rare"]
        )
        if operation == "send":
            player.send("user", dice.choice(FORMATS).name, priority=dice.choice((0, 0, 0, 1)))
        elif operation == "hear" and worker.to_central:
            self.hear(worker)
        elif operation in ("listen", "begin", "end", "post"):
            getattr(worker, operation)()
        elif operation == "rare" and dice.random() < 0.5:
            self.kill(worker) if dice.random() < 0.2 else worker.reconnect()
        elif operation == "own lock":
            worker.lock()
        elif operation == "lock":
            number = player.number("user")
            player.receive(
                "user",
                headers.Lock(number, "it", worker.name, timeout=-1, priority=dice.choice((0, 1))),
            )
        elif operation in ("unlock", "give up"):
            central = player.central
            due = central.registry.connections[ConnectionId(b"user")].outstanding
            asked = [number for number, one in due.items() if isinstance(one, Delivery)]
            if operation == "unlock":
                asked = [number for _, number in central.claims]
            if asked:
                player.receive("user", headers.GiveUp(dice.choice(asked)))
        elif operation == "work" and dice.random() < 0.2:
            self.work()

    def hear(self, worker: Worker) -> None:
        """Let central receive the next packet of a worker."""
        header, body = worker.to_central.popleft()
        self.player.receive(worker.slot.decode(), header, body)

    def deliver(self) -> None:
        """Take the packets of central for the workers."""
        for worker in self.workers:
            packets = self.player.inbox.get(worker.slot.decode(), [])
            worker.from_central.extend(packets)
            packets.clear()

    def finish(self) -> None:
        """Deliver all packets and let all handlers return."""
        for _, number in list(self.player.central.claims):
            self.player.receive("user", headers.GiveUp(number))
        for _ in range(5_000):  # a slot that prefetches nothing handles one message a round
            self.deliver()
            if not (
                self.player.central.dispatcher.running
                or any(worker.is_busy for worker in self.workers)
            ):
                return
            for worker in self.workers:
                if worker.locking is not None:
                    worker.lock()
                worker.begin()
                worker.end()
                worker.post()
                worker.listen()
                while worker.to_central:
                    self.hear(worker)


def check_times(town: Town) -> None:
    """Assert that the recorded runs of a worker do not overlap, and are never earlier than the true
    ones.
    """
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


def check_charts(town: Town) -> None:
    """Assert that no two drawn spans overlap, and that the waits of each message include what holds
    it.
    """
    history, feed = History(), Feed()
    for entry in town.player.entries:
        history.apply(entry)
        feed.apply(entry)
    ends, spans = feed.columns._tables["end"], feed.columns._tables["span"]
    over = dict(zip(ends["span:i"], ends["time:d"], strict=True))
    places = zip(*(spans[name] for name in ("row:i", "kind:t", "lane:i")), strict=True)
    free: dict[tuple[Any, ...], float] = {}
    for number, (place, start) in enumerate(zip(places, spans["start:d"], strict=True)):
        assert free.get(place, 0.0) <= start <= over.get(number, start)
        free[place] = over.get(number, start)
    for message in history.messages.values():
        waits = waits_of(history, message.id)
        for time in {wait.start for wait in waits}:
            at, known_waits = (
                RunAt(history, time),
                {wait.on for wait in waits if wait.start <= time < wait.end},
            )
            assert {
                wait.on for wait in blocking_waits(at, next_node(at, message.id))
            } <= known_waits


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
        name
        for module in central.registry.modules.values()
        for name, one in module.resources.items()
        if one.waiting
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
    check_charts(town)
    assert checked([OPENED, *town.player.entries]) == []
    return town


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(8, soak=500), phases=NO_SMALLER_SEED)
def test_prefetched_messages_start_once_and_in_order(seed: int) -> None:
    live(seed, lives(250, soak=1000))

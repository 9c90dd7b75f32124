"""The tools name the ends of a wait: the last waits of its chain. In random lives, central shows
that the named ends are necessary and sufficient.

1. *Necessary*: each handler that the ends do not name returns. Each other lock is released, and
each other task is resumed. The waiting task must still wait. 2. *Sufficient*: only what the ends
name is done, again and again. The waiting task must reach the awaited moment.
"""

from collections.abc import Iterator
from typing import Any

import pytest
from central.player import Player, before, point
from hypothesis import example, given, settings
from hypothesis import strategies as st
from properties.blocking import Blocking, Steps, free_handlers
from sampling import lives

from tca_central.core import Central
from tca_central.events import Effect
from tca_central.model.deliveries import Connection, Delivery, ModuleClaim
from tca_tools.explain.graph import End, Ends
from tca_tools.explain.waits import Node
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Killed
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.vocabulary import Role
from tca_wire.waits import WaitKind
from tca_wire.waits.ends import MOST

numbers = st.integers(0, 50)
steps = st.lists(
    st.tuples(
        st.sampled_from(
            ["send"] * 6
            + [
                "plan ahead",
                "ask",
                "ask",
                "ask all",
                "wait",
                "lock",
                "lock",
                "give up",
                "return",
                "return",
                "return",
                "kill",
                "suspend",
                "lose",
                "constrain",
                "fail",
                "retry",
            ]
        ),
        numbers,
        numbers,
        numbers,
    ),
    max_size=30,
)
LATER, LONG = 1_000.0, 10_000.0
"""A delay in seconds, and a time after which all delays are over."""
FLAGS = (
    Flags.NONE,
    Flags.SEQ_ACH,
    Flags.SEQ_ACH | Flags.DELAY_PLANNING,
    Flags.PLAN_FIRST,
    Flags.SEQ_ACH | Flags.SEQ_PLANNING,
)
AWAITED = [*Moment, Moment.START_ACHIEVING, Moment.END_PLANNING]
HELD = [*Moment, Moment.START_PLANNING, Moment.START_ACHIEVING]
ROUNDS = 100
"""The number of repetitions after which the waiting task must have reached the awaited moment."""


class Life(Blocking):
    """Handlers that block, with more messages than they can handle."""

    handled = {  # noqa: RUF012
        "a": ("goal walk", "query where", "multi-query all", "exception handler recover"),
        "b": ("command move", "query look", "multi-query all"),
        "d": ("goal step", "query pose"),
    }
    names = ("walk", "move", "step", "move", "later")
    questions = ("where", "look", "pose", "never")

    def __init__(self) -> None:
        self.events: list[object] = []
        super().__init__(looks=False)
        self.check = False
        self.declare("user", "command later", "query never")
        self.request("user", headers.Attach, Attachment("", "recover", 2), ROOT)

    def event(self, event: object) -> list[Effect]:
        self.events.append(event)
        return super().event(event)

    def free(self) -> list[Delivery]:
        return may_return(self.central)

    def do(self, operation: str, a: int, b: int, c: int) -> None:
        free, tasks = self.free(), list(self.central.tree.tasks.values())
        delivery = free[a % (len(free) + 1)] if a % (len(free) + 1) < len(free) else None
        sender = delivery.slot.id.decode() if delivery and delivery.slot else "user"
        origin = delivery.handling_id if delivery else 0
        if sender == "user" and self.central.registry.connections[b"user"].waits:  # type: ignore[index]
            return
        if operation == "return" and delivery and delivery.role is Role.EXCEPTION and c % 2:
            self.resolve(sender, origin)
        if operation == "send":
            self._send(delivery, a, b, c)
        elif operation == "plan ahead":
            parent = delivery.id if delivery and delivery.message.message_class.is_task else 0
            planned = self.task(sender, "walk", under=parent, origin=origin)
            begun = before(point(planned, AWAITED[b % 8]), point(-1, Moment.START_PLANNING))
            self.send(
                sender, "step", under=parent, origin=origin, flags=Flags.NONE, constraints=(begun,)
            )
        elif operation.startswith("ask"):
            name = "all" if operation == "ask all" else self.questions[b % len(self.questions)]
            self.send(sender, name, origin=origin, blocking=True)
        elif operation == "fail" and delivery:
            self.fail(sender, "slipped", origin)
        elif operation == "retry" and tasks:
            self.request("operator", headers.Retry, TaskId(tasks[b % len(tasks)].id), body=b"\x08")
        elif operation == "give up":
            self._release(b)
        elif operation == "lose":
            slots = [one for one in self.central.registry.connections.values() if one.resource]
            if slots and c % 4 == 0:
                self.lose(slots[b % len(slots)].id.decode())
        elif operation == "lock":
            self.request(sender, headers.Lock, "abd"[b % 3], "", c % 3 == 0, origin, blocking=True)
        else:
            super().do(operation, a, b, c)

    def _send(self, delivery: Delivery | None, a: int, b: int, c: int) -> None:
        """Send a task; sometimes one with a constraint to or from another."""
        tasks = list(self.central.tree.tasks.values())
        sender = delivery.slot.id.decode() if delivery and delivery.slot else "user"
        origin = delivery.handling_id if delivery else 0
        parent = delivery.id if delivery and delivery.message.message_class.is_task else 0
        constraints = []
        if tasks and c % 2 == 0:
            one, other = (
                point(tasks[b % len(tasks)].id, AWAITED[a % 8]),
                point(-1, HELD[c // 2 % 8]),
            )
            one, other = (other, one) if a % 7 == 6 else (one, other)
            constraints.append(before(one, other, LATER * (b % 5 == 4)))
        name = self.names[b % len(self.names)]
        self.send(
            sender,
            name,
            under=parent,
            origin=origin,
            flags=FLAGS[c % 5],
            constraints=tuple(constraints),
        )

    def _release(self, b: int) -> None:
        """Release a lock, or give up a wait whose thread is not busy with a nested query."""
        connections = self.central.registry.connections.values()
        due = [
            (one, number) for one in connections for number in one.waits if len(one.handling) < 2
        ]
        due += [(claim.slot, claim.number) for claim in may_be_released(self.central)]
        if due:
            slot, number = due[b % len(due)]
            self.receive(slot.id.decode(), headers.GiveUp(number))


class Replay(Player):
    """A replay of a life that continues in another way."""

    def __init__(self, life: Life) -> None:
        super().__init__(check=False)
        self.central.search_delay = 0
        for event in life.events:
            self.event(event)
        self.time, self.numbers = life.time, dict(life.numbers)

    @property
    def at(self) -> RunAt:
        return RunAt(History.until(self.entries))

    def has_reached(self, node: Node) -> bool:
        """Whether a task has reached a moment, according to central."""
        assert node.moment
        task = self.central.tree.tasks.get(TaskId(node.number))
        return task is None or bool(task.reached & node.moment)

    def act(self, end: End) -> None:
        """Do what an end names. Raise AssertionError if central knows nothing of this kind."""
        if end.kind is WaitKind.RUNNING:
            free, attended = may_return(self.central), self.central.dispatcher.running.values()
            slots = [one.slot for one in attended if one.message_id == end.number]
            runs = [one for one in free if one.message_id == end.number]
            # Its thread may still be at work with a message that was handled within its last wait.
            runs = runs or [one for one in free if one.slot in slots]
            assert runs or any(self.nested_in(slot) for slot in slots), f"{end}: no free handler"
            for run in runs:
                self.answer(run)
            if not runs:  # that message waits itself
                nested = next(filter(None, map(self.nested_in, slots)))
                self.act(Ends.at(self.at).of(nested.message_id)[0])
        elif end.kind is WaitKind.HANDLER:
            self.take(self.at.run.messages[end.number].name)
        elif end.kind is WaitKind.RESUME:
            assert self.central.tree.tasks[TaskId(end.number)].suspended, f"{end} is not suspended"
            self.request("operator", headers.Suspend, TaskId(end.number), resume=True)
        elif end.kind is WaitKind.DELAY:
            self.tick(LONG)
        else:
            self.unlock_or_join(end)

    def nested_in(self, slot: Connection | None) -> Delivery | None:
        """Return the message that a thread handles within a wait, if it does."""
        handled = list(slot.handling) if slot is not None else []
        return handled[-1] if len(handled) > 1 else None

    def unlock_or_join(self, end: End) -> None:
        """Release a lock whose holder waits for nothing, or add a slot to an empty resource."""
        if claim := next(
            (one for one in may_be_released(self.central) if one.id == end.number), None
        ):
            self.release(claim)
            return
        at = self.at
        message, wanted = at.run.messages.get(end.number), at.run.claims.get(end.number)
        places: list[Any] = []
        if wanted:
            places = [wanted]
        elif message:
            places = [at.queueing_of(message), *at.copies_of(message)[1]]
        modules = {module.name: module for module in self.central.registry.modules.values()}
        empty = [
            one
            for one in places
            if one and not modules[one.module].resources[one.resource].capacity
        ]
        assert empty, f"{end}: no known reason why {message} is queued"
        self.hello(f"{empty[0].module}/{len(self.entries)}", empty[0].module, empty[0].resource)

    def answer(self, run: Delivery) -> None:
        """Let a handler return. An exception handler resolves its failure; otherwise the failed
        task would be killed.
        """
        if run.slot is not None:
            if run.role is Role.EXCEPTION:
                self.resolve(run.slot.id.decode(), run.handling_id)
            self.reply(run.slot.id.decode(), run.handling_id)

    def take(self, name: str) -> None:
        """Let a module join that handles the message."""
        message = self.central.registry.messages[name]
        self.module(f"new{len(self.entries)}", f"{message.message_class} {name}", capacity=2)

    def release(self, claim: ModuleClaim) -> None:
        self.receive(claim.slot.id.decode(), headers.GiveUp(claim.number))


def may_return(central: Central) -> list[Delivery]:
    """Return the deliveries of handlers that wait for nothing, not even briefly."""
    return [one for one in free_handlers(central) if one.slot and not _pauses(one.slot, one)]


def _pauses(slot: Connection, run: Delivery) -> bool:
    return any(pause.since > slot.handling[run] for pause in slot.unchecked_waits.values())


def may_be_released(central: Central) -> list[ModuleClaim]:
    """Return the granted locks whose holder waits for nothing."""
    granted, free = (
        [claim for claim in central.claims.values() if claim.is_granted],
        may_return(central),
    )
    return [
        one
        for one in granted
        if (one.holder in free if one.holder else not (one.slot.waits or one.slot.unchecked_waits))
    ]


# --- the two checks ---------------------------------------------------------------------------------


def assert_ends_necessary(life: Life, ends: tuple[End, ...], nodes: list[Node]) -> None:
    replay, named = Replay(life), {end.number for end in ends}
    ends_before, killed = Ends.at(replay.at), len(replay.facts(Killed))
    done = list(do_the_rest(replay, ends, named))
    left = [node for node in nodes if not replay.has_reached(node)]
    if len(replay.facts(Killed)) == killed:  # a failed exception handler kills, and so ends waits
        assert left == nodes, (
            f"{set(nodes) - set(left)} waited for {ends}, but this was enough: {done} {ends_before}"
        )


def do_the_rest(replay: Replay, ends: tuple[End, ...], named: set[int]) -> Iterator[object]:
    """Do everything that the ends do not name."""
    central, kinds = replay.central, {end.kind for end in ends}
    held = [one for one in may_be_released(central) if one.id not in named]
    held = [one for one in held if one.holder is None or one.holder.message_id not in named]
    for run in [one for one in may_return(central) if one.message_id not in named]:
        replay.answer(run)
        yield run
    for claim in held:
        if claim.is_granted:
            replay.release(claim)
            yield claim
    if WaitKind.RESUME not in kinds:
        for task in [one for one in central.tree.tasks.values() if one.suspended]:
            replay.request("operator", headers.Suspend, TaskId(task.id), resume=True)
            yield f"{task} resumed"
    if WaitKind.HANDLER not in kinds:
        for name in ("later", "never"):
            replay.take(name)
    if WaitKind.DELAY not in kinds:
        replay.tick(LONG)
        yield "time"


def assert_ends_sufficient(life: Life, node: Node) -> None:
    replay, named_ends = Replay(life), []
    for _ in range(ROUNDS):
        if replay.has_reached(node):
            return
        ends = Ends.at(replay.at).of_node(node)
        if ends[0].kind in (WaitKind.CIRCLE, WaitKind.CONDITION):
            return
        named_ends.append(ends)
        replay.act(ends[0])
    pytest.fail(f"{node} was not reached by the named ends: {named_ends[:20]}")


@example(
    [
        ("send", 0, 0, 0),
        ("send", 1, 0, 0),
        ("send", 1, 0, 1),
        ("return", 0, 0, 0),
        ("kill", 1, 0, 0),
    ]
)  # a retry of a running task
@example(
    [
        ("send", 0, 0, 0),
        ("send", 0, 34, 0),
        ("return", 0, 0, 0),
        ("retry", 0, 0, 0),
        ("send", 0, 0, 0),
    ]
)  # a retry after its handler
@example(
    [("send", 0, 0, 38), ("suspend", 0, 0, 1), ("retry", 0, 0, 0)]
)  # a retry of a suspended task
@example(
    [
        ("send", 0, 1, 0),
        ("send", 0, 0, 0),
        ("lock", 0, 0, 0),
        ("send", 0, 0, 0),
        ("fail", 0, 0, 0),
        ("fail", 1, 0, 0),
    ]
)  # a failure in an exception handler kills the task
@example(
    [
        ("send", 0, 1, 0),
        ("send", 0, 0, 0),
        ("send", 0, 1, 0),
        ("ask", 1, 0, 0),
        ("lock", 0, 1, 0),
        ("fail", 0, 0, 0),
        ("return", 0, 0, 0),
        ("send", 0, 1, 0),
        ("retry", 0, 0, 0),
    ]
)  # a lock holder is retried
@example(
    [("send", 0, 0, 0)] + [("send", 0, 1, 0)] * 3 + [("fail", 0, 0, 0)]
)  # an exception handler deals with a failure
@example([("send", 0, 0, 0), ("send", 0, 0, 0), ("wait", 0, 1, 0)])  # a message within a wait
@example(
    [
        *(("send", 0, 0, 0), ("send", 0, 0, 0), ("ask", 0, 1, 0)),
        *(("wait", 0, 1, 0), ("ask", 1, 1, 0)),
    ]
)  # a message within a wait that waits, too
@given(steps)
@settings(max_examples=lives(15, soak=5_000))
def test_named_wait_ends_are_necessary_and_sufficient(taken: Steps) -> None:
    life = Life()
    for step in taken:
        life.do(*step)
    at = Replay(life).at
    waiting: dict[tuple[End, ...], list[Node]] = {}
    for task in life.central.tree.tasks.values():
        for moment in Moment:
            if not task.reached & moment:
                node = Node(task.id, moment)
                waiting.setdefault(Ends.at(at).of_node(node), []).append(node)
    for ends, nodes in waiting.items():
        if len(ends) <= MOST and all(end.kind is not WaitKind.CONDITION for end in ends):
            assert_ends_necessary(life, ends, nodes)
            for node in dict.fromkeys((nodes[0], nodes[-1])):
                assert_ends_sufficient(life, node)

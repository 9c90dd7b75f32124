"""Random lives of modules with handlers that block while they wait, in all ways that exist."""

from collections.abc import Mapping
from typing import Self

from central.player import Player, before, point

from tca_central.core import Central
from tca_central.model.deliveries import Connection, Delivery
from tca_central.model.observers import Observation
from tca_central.model.tasks import Task
from tca_wire.constraints import Flags
from tca_wire.journal.facts import RequestRefused
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Refusal

HANDLED = {
    "a": ("goal walk", "query where"),
    "b": ("command move", "query look"),
    "c": ("goal step", "query pose"),
}
DELAYED = Flags.DELAY_PLANNING | Flags.SEQ_ACH
COROUTINES = "c"
"""The module whose handlers may wait for several answers at a time."""

Steps = list[tuple[str, int, int, int]]


class Blocking(Player):
    """A player of modules whose handlers do nothing while they wait."""

    handled: Mapping[str, tuple[str, ...]] = HANDLED

    def __init__(self, *, looks: bool) -> None:
        super().__init__()
        self.central.search_delay = 0.25 if looks else 0
        self.module("user")
        self.declare("user", *(message for handled in self.handled.values() for message in handled))
        for index, (name, handled) in enumerate(self.handled.items()):
            self.module(name, *handled, capacity=1 + index % 2, pool="")
        self.hello("operator")

    def live(self, taken: Steps) -> Self:
        """Take steps of a second each."""
        for step in taken:
            self.do(*step)
            self.tick(1.0)
        return self

    @property
    def refused(self) -> list[RequestRefused]:
        return [fact for fact in self.facts(RequestRefused) if fact.refusal is Refusal.DEADLOCK]

    def free(self) -> list[Delivery]:
        return free_handlers(self.central)

    def do(self, operation: str, a: int, b: int, c: int) -> None:
        """Let one handler, or the user, do something."""
        free, tasks = self.free(), [*self.central.tree.tasks.values()]
        delivery = free[a % (len(free) + 1)] if a % (len(free) + 1) < len(free) else None
        sender = delivery.slot.id.decode() if delivery and delivery.slot else "user"
        origin = delivery.handling_id if delivery else 0
        if sender == "user" and self.central.registry.connections[b"user"].waits:  # type: ignore[index]
            return
        task = tasks[b % len(tasks)] if tasks else None
        if operation == "return" and delivery:
            self.reply(sender, origin)
        elif operation == "send":
            names = ("walk", "move", "step")
            parent = delivery.id if delivery and delivery.message.message_class.is_task else 0
            flags = (Flags.NONE, Flags.SEQ_ACH, DELAYED, Flags.PLAN_FIRST)[c % 4]
            constraints = (
                (before(point(task.id, list(Moment)[c % 6]), point(-1, list(Moment)[a % 6])),)
                if task
                else ()
            )
            self.send(
                sender,
                names[b % 3],
                under=parent,
                flags=flags,
                constraints=constraints * (c % 5 == 0),
            )
        elif operation == "ask":
            blocks = self.blocks(delivery)
            self.send(sender, ("where", "look", "pose")[b % 3], origin=origin, blocking=blocks)
        elif operation == "wait" and task:
            blocks = self.blocks(delivery)
            self.request(
                sender,
                headers.AwaitPoint,
                point(task.id, list(Moment)[c % 6]),
                origin,
                blocking=blocks,
            )
        elif operation in ("follow", "any") and tasks:
            followed = [tasks[b % len(tasks)], tasks[c % len(tasks)]][: 1 + a % 2]
            self._wait_for(sender, delivery, followed, operation, is_below=c % 3 == 0)
        elif operation in ("await", "give up"):
            self._await(operation, b, c)
        elif operation == "lock":
            resource, reserve = ("a", "b", "c")[b % 3], c % 2 == 0
            self.request(sender, headers.Lock, resource, "", reserve, origin, blocking=True)
        else:
            self._steer(operation, a, b, c)

    def _await(self, operation: str, b: int, c: int) -> None:
        """Let a coroutine send more queries and await the first answer, or end one of its waits by
        a timeout.
        """
        coroutines = [one for one in self.central.dispatcher.running.values() if is_coroutine(one)]
        if not coroutines:
            return
        delivery = coroutines[b % len(coroutines)]
        assert delivery.slot
        sender, waits = delivery.slot.id.decode(), delivery.slot.waits
        if operation == "give up":
            for number in [number for number, wait in waits.items() if wait.is_coroutine][:1]:
                self.receive(sender, headers.GiveUp(number))
        elif not waits_in(delivery.slot, delivery):
            for name in ("where", "look", "pose")[b % 3 :][: 1 + c % 2]:
                self.send(sender, name, origin=delivery.handling_id)
            asked = [number for number in delivery.slot.outstanding if number not in waits]
            self.receive(sender, headers.AwaitAny(delivery.handling_id, asked[-1 - c % 3 :]))

    def _wait_for(
        self, sender: str, by: Delivery | None, tasks: list[Task], operation: str, *, is_below: bool
    ) -> None:
        """Wait for the first change of *tasks* or of their descendants (operation "follow"), or for
        the first end of *tasks* (operation "any").
        """
        asked, origin = [], by.handling_id if by else 0
        for task in tasks:
            number, place = self.number(sender), point(task.id, Moment.END_ACHIEVING)
            about = (TaskId(0), "", task.id) if is_below else (TaskId(task.id), "", TaskId(0))
            following = Observe(number, *about, origin=origin)
            self.receive(
                sender,
                following if operation == "follow" else headers.AwaitPoint(number, place, origin),
            )
            asked.append(number)
        outstanding = self.central.registry.connections[sender.encode()].outstanding  # type: ignore[index]
        seen = sum(
            one.notifications
            for number in asked
            if isinstance(one := outstanding[number], Observation)
        )
        self.receive(sender, headers.Await(asked[0], self.blocks(by), origin, asked[1:], seen=seen))

    def blocks(self, by: Delivery | None) -> bool:
        """Whether a wait of a handler also blocks the handler's thread."""
        return by is None or not is_coroutine(by)

    def _steer(self, operation: str, a: int, b: int, c: int) -> None:
        """Let the operator steer tasks. The operator never waits."""
        tasks = [TaskId(task) for task in self.central.tree.tasks]
        if not tasks:
            return
        one, other = tasks[a % len(tasks)], tasks[b % len(tasks)]
        header: object = headers.Kill(self.number("operator"), one)
        if operation == "constrain":
            wanted = before(point(one, list(Moment)[b % 6]), point(other, list(Moment)[c % 6]))
            header = headers.Constrain(self.number("operator"), [wanted])
        elif operation == "suspend":
            header = headers.Suspend(self.number("operator"), one, c % 2 == 0)
        elif operation != "kill":
            return
        self.receive("operator", header)

    def go_on(self) -> None:
        """Let every handler return that can, until none can."""
        for _ in range(1000):
            for task in [task for task in self.central.tree.tasks.values() if task.suspended]:
                self.request("operator", headers.Suspend, TaskId(task.id), resume=True)
            self.tick(1.0)
            free = self.free()
            for claim in list(
                self.central.claims.values()
            ):  # each lock holder that waits for nothing releases its lock
                if claim.is_granted and (
                    claim.holder in free or not (claim.holder or claim.slot.waits)
                ):
                    self.receive(claim.slot.id.decode(), headers.GiveUp(claim.number))
            if not (free := self.free()):
                return
            assert free[0].slot
            self.reply(free[0].slot.id.decode(), free[0].handling_id)


def is_coroutine(delivery: Delivery) -> bool:
    return delivery.slot is not None and delivery.slot.module.name == COROUTINES


def free_handlers(central: Central) -> list[Delivery]:
    """Return the deliveries of handlers that wait for nothing. Candidates are the newest delivery
    of each slot, and every coroutine.
    """
    attended = central.dispatcher.running.values()
    newest = {delivery.slot: delivery for delivery in attended}
    may_go_on = [one for one in attended if is_coroutine(one) or newest[one.slot] is one]
    return [one for one in may_go_on if one.slot and not waits_in(one.slot, one)]


def waits_in(slot: Connection, delivery: Delivery) -> bool:
    """Whether a handler waits. A coroutine waits for one of several answers; the thread of any
    other handler blocks for one. Within that wait the thread may begin a later delivery.
    """
    return any(
        wait.origin == delivery.handling_id
        if wait.is_coroutine
        else wait.since > slot.handling[delivery]
        and (delivery.has_begun or not 0 < wait.origin < delivery.handling_id)
        for wait in slot.waits.values()
    )

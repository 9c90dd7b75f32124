"""The journal records every open wait, and no other, in random lives of handlers that block."""

from central.player import point
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.blocking import Blocking, Steps, waits_in
from properties.folded import Folding
from sampling import lives

from tca_central.model.deliveries import Connection, Delivery, PresenceWait
from tca_central.model.observers import Observation
from tca_central.model.resources import Claim
from tca_central.state import Collector, TaskWait
from tca_tools.journal.fold import History
from tca_wire.packets import headers
from tca_wire.points import Moment

numbers = st.integers(0, 50)
steps = st.lists(
    st.tuples(
        st.sampled_from(
            [
                "send",
                "ask",
                "ask all",
                "ask and go on",
                "fetch",
                "fetch",
                "wait",
                "lock",
                "follow",
                "be there",
                "give up",
                "return",
                "return",
                "kill",
                "suspend",
                "lose",
            ]
        ),
        numbers,
        numbers,
        numbers,
    ),
    max_size=40,
)


class JournaledLife(Folding, Blocking):
    """Handlers that block in all ways, long or briefly. The journal is folded after every event."""

    handled = {  # noqa: RUF012
        "a": ("goal walk", "query where", "multi-query all"),
        "b": ("command move", "query look", "multi-query all"),
        "c": ("goal step", "query pose"),
    }

    def __init__(self) -> None:
        self.history = History()
        super().__init__(looks=True)
        self.declare("user", "query missing")

    def compare(self) -> None:
        """Assert that the waits of central are the open waits of the journal."""
        waits = [wait for run in self.history.handlings for wait in run.waits]
        waits += [wait for module in self.history.modules.values() for wait in module.waits]
        journaled = sorted(wait.awaited for wait in waits if wait.end is None)
        connections = self.central.registry.connections.values()
        open_waits = [
            (one, number) for one in connections for number in (*one.waits, *one.unchecked_waits)
        ]
        assert journaled == sorted(awaited(one, number) for one, number in open_waits)

    def do(self, operation: str, a: int, b: int, c: int) -> None:
        free, brief = self.free(), c % 2 == 0
        delivery = free[a % (len(free) + 1)] if a % (len(free) + 1) < len(free) else None
        slot = delivery.slot if delivery else None
        slot = slot or self.central.registry.connections[b"user"]  # type: ignore[index]
        name, origin = slot.id.decode(), delivery.handling_id if delivery else 0
        if not delivery and (slot.waits or slot.unchecked_waits):
            return
        if operation.startswith("ask"):
            self.ask(name, origin, operation, b, brief=brief)
        elif operation == "fetch":
            if unblocked := [
                number
                for number, due in slot.outstanding.items()
                if isinstance(due, Delivery | Collector)
            ]:
                self.receive(name, headers.Await(unblocked[b % len(unblocked)]))
        elif operation == "wait":
            for task in [*self.central.tree.tasks.values()][b:][:1]:
                place = point(task.id, list(Moment)[c % 6])
                self.request(name, headers.AwaitPoint, place, origin, blocking=True, brief=brief)
        elif operation == "lock":
            self.request(
                name, headers.Lock, "abc"[b % 3], "", c % 3 == 0, origin, blocking=True, brief=brief
            )
        elif operation == "be there":
            self.request(name, headers.WaitUntilHandled, ["missing"], origin=origin)
        elif operation in ("give up", "lose"):
            self.end(operation, b, c)
        else:
            super().do(operation, a, b, c)

    def blocks(self, by: Delivery | None) -> bool:
        return True

    def ask(self, name: str, origin: int, operation: str, b: int, *, brief: bool) -> None:
        if operation == "ask all":
            self.send(name, "all", origin=origin, blocking=brief, maximum=b % 3)
        else:
            message = ("where", "look", "pose", "missing")[b % 4]
            self.send(name, message, origin=origin, blocking=operation == "ask", brief=brief)

    def end(self, operation: str, b: int, c: int) -> None:
        """Give up a wait, or lose a slot."""
        connections = self.central.registry.connections.values()
        if operation == "give up":
            for one in [one for one in connections if one.waits or one.unchecked_waits][b % 4 :][
                :1
            ]:
                name, (number, wait) = (
                    one.id.decode(),
                    next(iter((*one.unchecked_waits.items(), *one.waits.items()))),
                )
                self.receive(
                    name, headers.GiveUp(number, self.number(name) if c % 2 else 0, wait.origin)
                )
        elif c % 4 == 0:
            for one in [one for one in connections if one.resource][b:][:1]:
                self.lose(one.id.decode())

    def free(self) -> list[Delivery]:
        newest = {delivery.slot: delivery for delivery in self.central.dispatcher.running.values()}
        return [
            one
            for slot, one in newest.items()
            if slot and not waits_in(slot, one) and not slot.unchecked_waits
        ]


def awaited(slot: Connection, number: int) -> int:
    """Return the id of the message, task or claim that a connection waits for; 0 if it waits for a
    handler.
    """
    due = slot.outstanding[number]
    if isinstance(due, PresenceWait):
        return 0
    assert isinstance(due, Delivery | Collector | Claim | TaskWait | Observation)
    return int(due.task_id if isinstance(due, TaskWait | Observation) else due.id)


@given(steps)
@settings(max_examples=lives(20, soak=2_000))
def test_journal_records_every_wait(taken: Steps) -> None:
    JournaledLife().live(taken)

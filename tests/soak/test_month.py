"""Central does not grow during a month of work. Its memory of ended tasks and lost connections is
bounded, and full before the first measurement.
"""

import sys

import pytest
from central.player import Player, reachable
from central.test_random_lives import end_everything
from properties.life import Life

from tca_central.core import Central
from tca_central.events import ConnectionId, Effect, Transmit
from tca_central.model.memory import REMEMBERED_OUTCOMES
from tca_central.model.registry import REMEMBERED_CONNECTIONS
from tca_wire.packets import headers
from tca_wire.points import TaskId

FIRST, MONTH = 200_000, 2_600_000
"""Events, of a second each unless time is skipped. Modules join and leave with every twentieth
event.
"""
SLACK = 1_000
"""The allowed difference in the number of objects, for the newest answers. One object per thousand
events would exceed it.
"""


class Forgetful(Player):
    """A player that stores no received packet."""

    def note(self, effects: list[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, Transmit):
                self.inbox.setdefault(effect.connection.decode(), [])

    def lose(self, connection: str) -> list[Effect]:
        self.inbox.pop(connection, None)
        self.numbers.pop(connection, None)
        return super().lose(connection)


def size_of(central: Central) -> tuple[int, int]:
    """Return the number of objects reachable from central, without code, and their bytes."""
    count = size = 0
    for one in reachable(central):
        count += 1
        size += sys.getsizeof(one)
    return count, size


@pytest.mark.soak
def test_central_does_not_grow_in_a_month_of_dying_modules() -> None:
    life, sizes = Life(Forgetful(check=False)), []
    for seed, events in enumerate((FIRST, MONTH)):
        life.go_on(seed, events)
        end_everything(life)
        for task in [*life.central.registry.connections[ConnectionId(b"user")].module.retained]:
            life.request(headers.Keep, TaskId(task), release=True)
        assert not life.central.memory.records
        assert len(life.central.memory.outcomes) == REMEMBERED_OUTCOMES
        assert len(life.central.registry.lost) == REMEMBERED_CONNECTIONS
        sizes.append(size_of(life.central))
    (objects, size), (objects_then, size_then) = sizes
    assert abs(objects_then - objects) <= SLACK, sizes
    assert size_then <= size * 1.1, sizes

"""Random lives of handlers that block. A reported deadlock would never have ended, and no deadlock
is overlooked.

Each life is lived twice. The second central does not look for deadlocks. At the first refusal,
every handler of the second life returns that can return. The refused wait must still be open then.
In some lives central searches few edges at a time, so that the tree changes during a search.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from central.player import Player
from hypothesis import example, given, settings
from hypothesis import strategies as st
from properties.blocking import Blocking, Steps
from sampling import lives

from tca_central.deadlock import deadlocks
from tca_wire.journal.facts import Delivered
from tca_wire.packets import headers

numbers = st.integers(0, 50)
steps = st.lists(
    st.tuples(
        st.sampled_from(
            [
                "send",
                "send",
                "ask",
                "ask",
                "wait",
                "any",
                "follow",
                "follow",
                "await",
                "await",
                "lock",
                "constrain",
                "return",
                "kill",
                "suspend",
                "give up",
            ]
        ),
        numbers,
        numbers,
        numbers,
    ),
    max_size=30,
)


CALLED_BACK = [("send", 0, 44, 0), ("ask", 0, 44, 0), ("lock", 1, 2, 1), ("await", 0, 32, 0)]
"""A coroutine queries its own resource, which a handler nested in it has locked."""


LENT_LATER = [
    *(("ask", 0, 0, 0), ("lock", 0, 1, 1), ("send", 0, 0, 0), ("wait", 0, 0, 1)),
    *(("send", 0, 0, 0), ("ask", 0, 1, 0), ("send", 0, 0, 0)),
]
"""A slot is lent only after an interrupted search."""


@given(steps)
@example(CALLED_BACK)
@settings(max_examples=lives(20, soak=5_000))
def test_reported_deadlocks_are_exactly_the_endless_waits(taken: Steps) -> None:
    assert_deadlocks_are_exact(taken)


@given(steps, st.integers(1, 6))
@example(LENT_LATER, 3)
@settings(max_examples=lives(20, soak=5_000))
def test_interrupted_deadlock_search_finds_the_same_deadlocks(taken: Steps, edges: int) -> None:
    with limited_search(edges):
        assert_deadlocks_are_exact(taken, is_interrupted=True)


def test_deadlock_search_ends_when_lock_request_is_withdrawn() -> None:
    player = Blocking(looks=True)
    with limited_search(1):
        for _ in range(2):
            player.do("send", 0, 0, 0)
        free = player.free()[0]
        assert free.slot is not None
        sender = free.slot.id.decode()
        number = player.number(sender)
        player.receive(
            sender, headers.Lock(number, "b", "", origin=free.handling_id, blocking=True)
        )
        player.time += 0.25
        player.tick(0.0)
        assert player.central.scan is not None
        player.receive(sender, headers.GiveUp(number))
        finish_search(player)


@contextmanager
def limited_search(edges: int) -> Iterator[None]:
    """Limit the edges that central searches in one event."""
    usual = deadlocks.PATIENCE, deadlocks.SLICE
    deadlocks.PATIENCE = deadlocks.SLICE = edges
    try:
        yield
    finally:
        deadlocks.PATIENCE, deadlocks.SLICE = usual


def finish_search(player: Player) -> None:
    """Let central finish its searches and their consequences."""
    for _ in range(10_000):
        if player.central.search_timer is None:
            return
        player.tick(0.25)
    raise AssertionError("the search of central never ends")


def assert_deadlocks_are_exact(taken: Steps, *, is_interrupted: bool = False) -> None:
    looking, blind = Blocking(looks=True), Blocking(looks=False)
    for index, step in enumerate(taken):
        looking.do(*step)
        if not looking.refused:
            looking.tick(1.0)
            blind.time += 1.0
        blind.do(*step)
        if is_interrupted and has_other_course(looking, blind):
            break  # the other life shows nothing any more, but this one must end
        if looking.refused or any(
            fact.failure == "deadlock" for fact in looking.facts_of("failed")
        ):
            still = all_waits(looking)
            before = Blocking(looks=False)  # the search may have come before this step
            for earlier in taken[:index]:
                before.do(*earlier)
                before.time += 1.0
            refused = endless_waits(blind) - still or endless_waits(before) - still
            assert refused or not looking.refused, f"{looking.refused} would have ended"
            return
    for _ in range(100):
        looking.go_on()
        finish_search(looking)
    assert not all_waits(looking), f"{all_waits(looking)} will never end, but were not reported"


def has_other_course(looking: Blocking, blind: Blocking) -> bool:
    """Whether a slot was lent in one life only: a search that is interrupted lends it later."""
    nested = [
        {one.id for one in player.facts(Delivered) if one.is_nested} for player in (looking, blind)
    ]
    return nested[0] != nested[1]


def all_waits(player: Player) -> set[tuple[bytes, int]]:
    return {(slot.id, number) for slot in player.central.blocked for number in slot.waits}


def endless_waits(player: Blocking) -> set[tuple[bytes, int]]:
    player.go_on()
    return all_waits(player)

"""The table of statuses, and its protection against a lossy network."""

from functools import partial

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from turtles.lossy import LossyNetwork

from robots.turtle_sim.errors import DamagedDatagram, NoSuchPartner
from robots.turtle_sim.sync.statuses import Datagram, Statuses, VersionedStatus

NAMES = ["a", "b", "c"]


def exchange(one: Statuses, other: Statuses) -> None:
    """Exchange all datagrams between two tables without loss."""
    tables = {one.name: one, other.name: other}
    (raw,) = (datagram for partner, datagram in one.due() if partner == other.name)
    sender, receiver = one.name, other.name
    while (answer := tables[receiver].receive(sender, raw)) is not None:
        sender, receiver, raw = receiver, sender, answer


@given(
    st.integers(0, 10**6),
    st.lists(st.tuples(st.sampled_from(NAMES), st.integers(-5, 5)), max_size=12),
)
def test_statuses_converge_and_then_traffic_stops(
    seed: int, changes: list[tuple[str, int]]
) -> None:
    network = LossyNetwork(NAMES, seed)
    for number, (name, status) in enumerate(changes):
        network.at(0.1 * number, partial(network.tables[name].set, status))
    network.run(
        lambda: (
            network.now > 0.1 * len(changes)
            and not any(one.waiting_for() for one in network.tables.values())
        )
    )
    last = {**dict.fromkeys(NAMES, 0), **dict(changes)}
    for table in network.tables.values():
        assert {name: entry.status for name, entry in table.known.items()} == last
    sent = network.sent
    network.run(lambda: network.now > 0.1 * len(changes) + 10.0)
    quiet_from = network.sent
    network.run(lambda: network.now > 0.1 * len(changes) + 20.0)
    assert network.sent == quiet_from
    assert quiet_from - sent < 50  # delayed datagrams, with their acknowledgements


def test_three_datagrams_suffice_without_loss() -> None:
    a, b = Statuses("a", ["b"]), Statuses("b", ["a"])
    a.set(7)
    raw = a.due()[0][1]
    answer = b.receive("a", raw)
    assert answer is not None
    last = a.receive("b", answer)
    assert last is not None
    assert b.receive("a", last) is None
    assert (a.waiting_for(), b.waiting_for()) == ([], [])
    assert (a.status("b"), b.status("a")) == (0, 7)


def test_statuses_never_overtake_their_causes() -> None:
    """Robot b reacts to a. Robot c gets datagrams of b only, but also learns a's status."""
    a, b, c = (Statuses(name, [other for other in NAMES if other != name]) for name in NAMES)
    exchange(a, c)
    a.set(1)
    exchange(a, b)
    b.set(1)
    exchange(b, c)
    assert (c.status("b"), c.status("a")) == (1, 1)


def test_restarted_robot_is_trusted_again() -> None:
    a, b = Statuses("a", ["b"]), Statuses("b", ["a"])
    for status in (1, 2, 3):
        a.set(status)
    exchange(a, b)
    anew = Statuses("a", ["b"])
    exchange(anew, b)
    assert b.status("a") == 0
    anew.set(5)
    exchange(anew, b)
    assert b.status("a") == 5


def test_unknown_silent_and_misnamed_partners_are_distinguished() -> None:
    a = Statuses("a", ["b", "c"])
    with pytest.raises(NoSuchPartner, match="'a' has no partner 'd': its partners are b, c"):
        a.status("d")
    with pytest.raises(NoSuchPartner, match="its partners are none"):
        Statuses("a", []).status("b")
    assert a.status("b") is None
    assert a.words("b") == "'b' has sent nothing: does it run, and is its address right?"
    a.receive("b", Statuses("bee", ["a"]).due()[0][1])
    assert a.words("b") == "the robot at the address of 'b' calls itself 'bee': rename one"
    a.receive("c", Statuses("c", ["a"], status=4).due()[0][1])
    assert a.words("c") == "the status of 'c' is 4"


@given(st.binary(max_size=60))
@example(b"\x93\xa4\x00\x00\x00\x80")  # a name that is not a string
def test_damaged_datagram_changes_nothing(raw: bytes) -> None:
    a = Statuses("a", ["b"])
    try:
        a.receive("b", raw)
    except DamagedDatagram:
        assert a.known.keys() == {"a"}
        assert a.waiting_for() == ["b"]


NAMED = st.sampled_from([*NAMES, "d"])
ENTRIES = st.dictionaries(
    NAMED, st.builds(VersionedStatus, st.integers(1, 2**53), st.integers(-9, 9))
)


@given(st.lists(st.builds(Datagram, NAMED, ENTRIES, st.booleans()), max_size=5))
def test_own_status_is_never_changed_by_partners(
    datagrams: list[Datagram],
) -> None:
    a = Statuses("a", ["b", "c"], status=7)
    for datagram in datagrams:
        a.receive("b", msgspec.msgpack.encode(datagram))
        assert a.known["a"].status == 7
        assert a.known["a"] >= datagram.known.get("a", a.known["a"])  # so it is accepted
    a.set(8)
    assert a.known["a"].status == 8

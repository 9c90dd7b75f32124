"""Pulses: central finds stopped processes by heartbeats that are not echoed."""

from itertools import count

import pytest
from central.player import Player

from tca_central.events import ConnectionId
from tca_central.model.deliveries import Connection
from tca_central.shell.pulses import LATE, Pulses
from tca_wire.packets.headers import PROTOCOL_VERSION, Hello, Refused
from tca_wire.vocabulary import Limit, Refusal

NUMBERS = count(1)


def connection_of(pulse: bytes) -> Connection:
    (connection,) = Player.of("legs").central.registry.connections.values()
    connection.id, connection.pulse = ConnectionId(b"connection %d" % next(NUMBERS)), pulse
    return connection


def beat(pulses: Pulses, *connections: Connection) -> set[bytes]:
    """Send a heartbeat to every pulse. Return the pulses that are silent for too long."""
    beating = pulses.start_round(connections)
    silent = pulses.silent()
    for pulse in beating - silent:
        pulses.mark_sent(pulse)
    return silent


def test_process_that_echoes_no_heartbeat_is_silent() -> None:
    pulses, legs, eyes = Pulses(2), connection_of(b"legs"), connection_of(b"eyes")
    for _ in range(3):
        assert beat(pulses, legs, eyes) == set()
        pulses.active |= {b"legs", b"eyes"}
    assert beat(pulses, legs, eyes) == set()
    pulses.active.add(b"eyes")
    assert beat(pulses, legs, eyes) == set()
    pulses.active.add(b"eyes")
    assert beat(pulses, legs, eyes) == {b"legs"}
    pulses.active.add(b"eyes")
    assert beat(pulses, eyes) == set()  # the legs have been lost, and come back in the next beat
    pulses.active.add(b"eyes")
    assert beat(pulses, legs, eyes) == set()
    pulses.active |= {b"legs", b"eyes"}
    assert beat(pulses, legs, eyes) == set()


def test_heartbeat_read_at_the_last_moment_counts() -> None:
    pulses, legs = Pulses(1), connection_of(b"legs")
    beat(pulses, legs)
    assert beat(pulses, legs) == {b"legs"}
    pulses.active.add(b"legs")
    pulses.count_signs([legs])
    assert pulses.silent() == set()


def test_any_packet_of_a_process_is_a_sign_of_life() -> None:
    pulses, legs, leg = Pulses(1), connection_of(b"legs"), connection_of(b"legs")
    for _ in range(5):
        assert beat(pulses, legs, leg) == set()
        pulses.active.add(leg.id)
    assert beat(pulses, legs, leg) == set()
    assert beat(pulses, legs, leg) == {b"legs"}


def test_connection_without_pulse_is_not_watched() -> None:
    pulses, old = Pulses(1), connection_of(b"")
    assert [beat(pulses, old) for _ in range(3)] == [set()] * 3


def test_closed_pulse_line_does_not_count_as_silence() -> None:
    pulses, legs = Pulses(1), connection_of(b"legs")
    beat(pulses, legs)
    pulses.active.add(b"legs")
    for _ in range(3 * LATE):
        assert pulses.start_round([legs]) == {b"legs"}
        pulses.mark_closed(b"legs")  # as the socket reports
        assert pulses.silent() == set()
    beat(pulses, legs)
    assert beat(pulses, legs) == {b"legs"}


def beats_until_silence_without_line(pulses: Pulses, *connections: Connection) -> int:
    """Return the number of heartbeats after which a process without a pulse line counts as silent,
    or 0.
    """
    for beats in range(3 * LATE):
        if pulses.silent():
            return beats
        for pulse in pulses.start_round(connections):
            pulses.mark_closed(pulse)
    return 0


def test_pulse_line_that_never_opens_counts_as_silence() -> None:
    """Otherwise central would never notice a process that is stopped in its first milliseconds."""
    assert beats_until_silence_without_line(Pulses(2), connection_of(b"legs")) == 1 + LATE + 2


def test_late_pulse_line_is_watched_from_then_on() -> None:
    pulses, legs = Pulses(2), connection_of(b"legs")
    for _ in range(LATE):
        pulses.start_round([legs])
        pulses.mark_closed(b"legs")
    for _ in range(2):
        assert beat(pulses, legs) == set()
    assert beat(pulses, legs) == {b"legs"}


def test_packet_before_pulse_line_opens_restarts_the_grace() -> None:
    pulses, legs = Pulses(2), connection_of(b"legs")
    for _ in range(3):
        pulses.start_round([legs])
        pulses.mark_closed(b"legs")
    pulses.active.add(legs.id)
    assert beats_until_silence_without_line(pulses, legs) == 1 + LATE + 2


def test_returning_process_is_not_silent_without_a_line() -> None:
    pulses, legs = Pulses(2), connection_of(b"legs")
    beat(pulses, legs)
    beat(pulses)
    assert beats_until_silence_without_line(pulses, legs) == 0


@pytest.mark.parametrize("length", [Limit.NAME, Limit.NAME + 1])
def test_pulse_name_length_is_limited(length: int) -> None:
    hello = Hello(1, PROTOCOL_VERSION, "legs", "1", pulse=bytes(length))
    (answer, *_) = Player().receive("legs", hello)
    if length > Limit.NAME:
        assert answer == Refused(1, Refusal.PROTOCOL, "a pulse is named by at most 128 bytes")
    else:
        assert not isinstance(answer, Refused)

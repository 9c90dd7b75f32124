"""The events that an input contains, for the daemon and for the replay of a log of inputs."""

from collections.abc import Callable, Sequence

from tca_central.events import Arrived, BadBytes, Event, Input, RequestReceived, RequestSkipped
from tca_wire.errors import ProtocolError
from tca_wire.packets import codec
from tca_wire.packets.large import MARK

Adopt = Callable[[bytes], bytes]
"""Returns a large body in the form that central's core gets."""


def events_of(event: Input, spared: int = -1, adopt: Adopt = bytes) -> Sequence[Event]:
    """Return the events of an input. *adopt* gets each large body.

    *spared* is the index of the request in which central crashed (-1: it did not crash). This
    request is not handled again: bad bytes replace it, which central refuses.
    """
    if isinstance(event, RequestSkipped):
        return ()
    if not isinstance(event, Arrived):
        return (event,)
    now, connection, principal = event.time, event.connection, event.principal
    try:
        items = codec.unpack_to_central(event.packet)
    except ProtocolError as error:
        return (BadBytes(now, connection, str(error)),)
    events: list[Event] = [
        RequestReceived(
            now, connection, header, adopt(body) if body[:1] == MARK else body, principal
        )
        for header, body in items
    ]
    if 0 <= spared < len(events):
        events[spared] = BadBytes(
            now, connection, "central ended by an error of its own in it: it is not tried again"
        )
    return events

"""Large bodies at central's border: modules without shared memory, and answers on their way."""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from tca_central.core import Central
from tca_central.events import ConnectionId
from tca_central.shell.outboxes import Outboxes
from tca_central.shell.store import Store
from tca_wire.errors import ProtocolError
from tca_wire.packets import codec
from tca_wire.packets.headers import Answer, ToModule, Welcome
from tca_wire.packets.large import MARK, LargeBody, held_size, is_large, unpack_handle
from tca_wire.packets.parts import StateChange
from tca_wire.vocabulary import Limit

_decode_change = msgspec.msgpack.Decoder(StateChange).decode


class _Sent(NamedTuple):
    """An answer whose segment is held until its receiver has opened it."""

    end: int  #: the bytes that the connection has read when it has read this answer
    size: int
    body: bytes


@dataclass(slots=True)
class _Reader:
    """A connection with answers to read."""

    read: int = 0  #: bytes since the first answer
    sent: deque[_Sent] = field(default_factory=deque)  #: oldest first
    held: int = 0  #: bytes of the segments

    def release_oldest(self) -> None:
        """Hold the oldest answer no longer."""
        self.held -= self.sent.popleft().size


class LargeBodies:
    """Converts large bodies of modules that share no memory with central.

    Such a module sends and gets the bytes of a segment behind the handle. The bytes of more than
    Limit.BODY are not sent: the module gets the handle, and reports that it can't read the data.

    Args:
        central: The core.
        store: The store of the segments.
        outboxes: The outboxes of all connections.
    """

    def __init__(self, central: Central, store: Store, outboxes: Outboxes) -> None:
        self.store = store
        self._central, self._outboxes = central, outboxes
        #: The core may forget an answer at once, but its receiver has yet to open the segment.
        self._readers: dict[ConnectionId, _Reader] = {}
        #: The newest body that was read from a segment, and its inline form, for many receivers.
        self._read = b"", b""

    def note_sharing(self, connection: ConnectionId) -> None:
        """Note that the module of a connection shares memory."""
        if (known := self._central.registry.connections.get(connection)) is not None:
            self.store.add_module(known.module.incarnation)

    def _shares(self, connection: ConnectionId) -> bool:
        known = self._central.registry.connections.get(connection)
        return known is not None and self.store.is_shared_with(known.module.incarnation)

    # --- in ---------------------------------------------------------------------------------------

    def with_segments(self, packet: bytes) -> bytes:
        """Return a packet with the bytes behind its handles moved to segments."""
        if self.store.folder is None:
            return packet
        try:
            items = codec.unpack_to_central(packet)
            moved = [(header, self._with_segment(body)) for header, body in items]
        except ProtocolError:
            return packet  # it is refused
        has_moved = any(new is not body for (_, new), (_, body) in zip(moved, items, strict=True))
        return codec.pack(moved) if has_moved else packet

    def _with_segment(self, body: bytes) -> bytes:
        if body[:1] != MARK or len(body) > Limit.BODY:
            return body
        handle, rest = unpack_handle(body)
        try:
            return body if handle.segment else self.store.write(handle, rest)
        except OSError:
            return body  # the memory is full: the core holds the bytes

    # --- out --------------------------------------------------------------------------------------

    def enqueue(self, connection: ConnectionId, header: ToModule, body: bytes) -> None:
        """Queue a Welcome with the name of the store, or a large body, inline if necessary."""
        if isinstance(header, Welcome):
            folder = self.store.folder
            header = msgspec.structs.replace(header, store=str(folder) if folder else "")
        elif not self._shares(connection):
            body = self._inline(body) if is_large(body) else self._inline_change(body)
        self._outboxes.add(connection, codec.pack_in_pieces(header, body))
        if isinstance(header, Answer) and isinstance(body, LargeBody):
            self._hold(connection, body)

    def _inline(self, body: bytes) -> bytes:
        """Return a body with its bytes behind its handle, if they are there and not too many."""
        if not is_large(body):
            return body
        handle, _ = unpack_handle(body)
        if not handle.segment or len(body) + handle.size > Limit.BODY:
            return body
        if body == self._read[0]:
            return self._read[1]
        try:
            self._read = bytes(body), self.store.read(handle)
        except OSError:
            return body  # its receiver reports that the data are lost
        return self._read[1]

    def _inline_change(self, body: bytes) -> bytes:
        """Return a change of a task's state with its data inline."""
        change = _decode_change(body)
        goal, data = self._inline(change.goal), self._inline(change.data)
        changed = codec.encode(msgspec.structs.replace(change, goal=goal, data=data))
        return changed if len(changed) <= Limit.BODY else body

    def _hold(self, connection: ConnectionId, body: LargeBody) -> None:
        """Hold the segment of an answer until its receipt, or until too much is held."""
        bodies = (body.owner.goal, body.owner.data) if isinstance(body.owner, StateChange) else ()
        size = sum(map(held_size, bodies or (body,)))
        if (reader := self._readers.get(connection)) is None:
            self._readers[connection] = reader = _Reader()
        end = reader.read + self._outboxes.ahead(connection)
        reader.sent.append(_Sent(end, size, body))
        reader.held += size
        while reader.held > self._central.budget.unread:
            reader.release_oldest()

    def credit(self, connection: ConnectionId, size: int) -> None:
        """Release the answers that a connection has read, with *size* more bytes."""
        if (reader := self._readers.get(connection)) is None:
            return
        reader.read += max(size, 0)
        while reader.sent and reader.sent[0].end <= reader.read:
            reader.release_oldest()
        if not reader.sent:
            del self._readers[connection]

    def sweep(self) -> None:
        """Release what is not needed any more. Called once a second."""
        self._read = b"", b""
        modules, connections = self._central.registry.modules, self._central.registry.connections
        for gone in [one for one in self._readers if one not in connections]:
            del self._readers[gone]
        self.store.settle(modules)
        self.store.sweep(modules)

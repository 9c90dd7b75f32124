"""Large bodies at central's border: modules without shared memory, and answers on their way."""

import time
from collections import deque

import msgspec

from tca_central.core import Central
from tca_central.events import ConnectionId
from tca_central.shell.store import Store
from tca_wire.errors import ProtocolError
from tca_wire.packets import codec
from tca_wire.packets.headers import Answer, ToModule, Welcome
from tca_wire.packets.large import MARK, held_size, is_large, unpack_handle
from tca_wire.packets.parts import StateChange
from tca_wire.vocabulary import Limit

READING_TIME = 5.0
"""Seconds for which the large data of a sent answer stay: central does not know when it is read."""

_decode_change = msgspec.msgpack.Decoder(StateChange).decode


class LargeBodies:
    """Converts large bodies of modules that share no memory with central.

    Such a module sends and gets the bytes of a segment behind the handle. The bytes of more than
    Limit.BODY are not sent: the module gets the handle, and reports that it can't read the data.
    """

    def __init__(self, central: Central, store: Store) -> None:
        self.store = store
        self._central = central
        #: Sent answers, oldest first: the time, the size and the body, which holds its segment.
        self._answers: deque[tuple[float, int, bytes]] = deque()
        self._answer_bytes = 0

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
        except (ProtocolError, OSError):
            return packet  # it is refused, or stays as it is
        has_moved = any(new is not body for (_, new), (_, body) in zip(moved, items, strict=True))
        return codec.pack(moved) if has_moved else packet

    def _with_segment(self, body: bytes) -> bytes:
        if body[:1] != MARK or len(body) > Limit.BODY:
            return body
        handle, rest = unpack_handle(body)
        return body if handle.segment else self.store.write(handle, rest)

    # --- out --------------------------------------------------------------------------------------

    def outgoing(
        self, connection: ConnectionId, header: ToModule, body: bytes
    ) -> tuple[ToModule, bytes]:
        """Return the header and body to send: Welcome names the store, and bodies may be inline."""
        if isinstance(header, Welcome):
            folder = self.store.folder
            return msgspec.structs.replace(header, store=str(folder) if folder else ""), body
        if not self._shares(connection):
            return header, self._inline(body)
        if isinstance(header, Answer):
            self._hold_answer(body)
        return header, body

    def _inline(self, body: bytes) -> bytes:
        """Return a body with its bytes behind its handle, if they are there and not too many."""
        if is_large(body):
            handle, _ = unpack_handle(body)
            if not handle.segment or len(body) + handle.size > Limit.BODY:
                return body
            try:
                return self.store.read(handle)
            except OSError:
                return body  # its receiver reports that the data are lost
        change = _decode_change(body)
        goal, data = self._inline(change.goal), self._inline(change.data)
        return codec.encode(msgspec.structs.replace(change, goal=goal, data=data))

    def _hold_answer(self, body: bytes) -> None:
        """Hold the segment of an answer for a while: central may forget the answer at once."""
        owner = getattr(body, "owner", None)
        bodies = (owner.goal, owner.data) if isinstance(owner, StateChange) else (body,)
        size = sum(map(held_size, bodies))
        self._answers.append((time.monotonic(), size, body))
        self._answer_bytes += size
        while len(self._answers) > 1 and self._answer_bytes > self._central.budget.unread:
            self._answer_bytes -= self._answers.popleft()[1]

    def sweep(self) -> None:
        """Release what is not needed any more. Called once a second."""
        until = time.monotonic() - READING_TIME
        while self._answers and self._answers[0][0] < until:
            self._answer_bytes -= self._answers.popleft()[1]
        modules = self._central.registry.modules
        self.store.settle(modules)
        self.store.sweep(modules)

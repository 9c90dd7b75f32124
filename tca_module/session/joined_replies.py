"""Joins replies: a slot with prefetched messages answers several messages with one header."""

from typing import Any

from tca_wire.packets.headers import Fail, Replies, Reply
from tca_wire.packets.large import is_large
from tca_wire.packets.parts import EndedRun

_MAX_JOINED_BYTES = 64 << 10  # bytes of replies that may share a header
_NIL = b"\xc0"

Item = tuple[Any, bytes]


class HeldReplies:
    """The replies of a turn, held back until they are sent together.

    In a turn, a slot handles messages one after the other.
    """

    def __init__(self) -> None:
        self._current = 0  #: the delivery that is being handled (0: none)
        self._started: float | None = None  #: when its handler started
        self.ended: dict[int, float] = {}  #: delivery -> when its handler ended

    def begin(self, delivery: int, now: float) -> None:
        """Start with the next delivery of the turn."""
        self._current, self._started = delivery, now

    def stop(self) -> None:
        """End the turn."""
        self._current, self._started = 0, None

    def clear(self) -> None:
        """Forget all held replies."""
        self.ended.clear()

    def hold(self, header: Reply | Fail, now: float) -> bool:
        """Hold a reply if it belongs to the turn; return whether it does."""
        if header.delivery != self._current or not isinstance(header, Reply):
            return False
        self.ended[header.delivery] = now
        self.stop()
        return True

    def joined(self, items: list[Item], now: float) -> list[Item]:
        """Return the items to send, with adjacent held replies joined. Forget all held replies."""
        # From the newest to the oldest: the header for some replies says how long ago the handler
        # after the last of them started.
        found: list[Item] = []
        next_began_ago = -1.0 if self._started is None else now - self._started
        runs: list[EndedRun] = []
        bodies: list[bytes] = []
        size = 0
        for header, body in reversed(items):
            ended = (
                self.ended.get(header.delivery)
                if isinstance(header, Reply) and not (header.refusals or is_large(body))
                else None
            )
            if runs and (ended is None or size + len(body) > _MAX_JOINED_BYTES):
                found.append(_join(runs, bodies, next_began_ago))
                next_began_ago = runs[-1].ago + runs[-1].took
                runs, bodies, size = [], [], 0
            if ended is None:
                found.append((header, body))
                continue
            bodies.append(b"" if body == _NIL else body)
            runs.append(EndedRun(header.delivery, now - ended, header.took, len(bodies[-1])))
            size += len(bodies[-1])
        if runs:
            found.append(_join(runs, bodies, next_began_ago))
        self.clear()
        return found[::-1]


def _join(runs: list[EndedRun], bodies: list[bytes], next_began_ago: float) -> Item:
    """Join the replies of runs, newest first, into one header."""
    if len(runs) == 1 and next_began_ago < 0:
        (run,) = runs
        return Reply(run.delivery, run.took), bodies[0] or _NIL
    return Replies(runs[::-1], next_began_ago), b"".join(reversed(bodies))

"""The leader's log of inputs in a replicated log, in place of files.

An image is appended in pieces, one a turn, so that no turn waits for a whole image.
"""

import logging
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from tca_central.errors import CentralError
from tca_central.events import Input, Standby
from tca_central.replication.records import Image, encode
from tca_central.replication.shared_log import Kind, SharedLog, cut
from tca_central.shell.input_log import IMAGE_SUFFIX, Ended

log = logging.getLogger("tca.central")

GONE = 2.0
"""Seconds without a sign of life after which a follower no longer counts as one."""
MOST_BEHIND = 1000
BEHIND = (0, 2, 10, 60, 600)
"""The seconds to which it is rounded how far a follower is behind. Each change is an input."""
BEAT = 0.3
"""Seconds without input after which the leader appends a tick. It shows followers that it lives."""


class SharedInputs:
    """The inputs of a run that this central leads.

    Args:
        log: The log.
        last: The last message of the log.
        member: This process, as "host:pid".
        epoch: The run.
        folder: A folder for images that are being written.
        clock: Tells the time in seconds. It never jumps.
    """

    beat = BEAT

    def __init__(
        self,
        log: SharedLog,
        last: int,
        member: str,
        epoch: str,
        folder: Path,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.folder = folder
        self.size = 0  #: bytes since the newest image
        self._log, self._member, self._epoch = log, member, epoch
        self._last, self._clock = last, clock
        self._turn: list[Input | Ended] = []
        self._image: deque[bytes] = deque()  #: pieces of an image to append
        self._part = 0  #: the number of the next piece
        self._image_after = 0  #: the last message that led to this image
        self._kept_after = 0  #: the same of the image before it
        self._error: CentralError | None = None  #: the first failure; nothing is appended after it
        #: The last message of each second, oldest first. It tells how far followers are behind.
        self._seconds: deque[tuple[float, int]] = deque(maxlen=MOST_BEHIND)

    def add(self, event: Input) -> None:
        """Append an input; ``flush`` writes it."""
        self._turn.append(event)

    def flush(self) -> None:
        """End a turn: append its inputs. They are safe when this returns. Raises CentralError."""
        if self._error is not None:
            raise self._error
        if self._turn:
            turn, self._turn = encode(self._turn), []
            self.size += len(turn)
            self._append(Kind.TURN, cut(turn))
        if self._image:
            piece = self._image.popleft()
            self._append(Kind.IMAGE, [piece], part=self._part, is_more=bool(self._image))
            self._part += 1
            if not self._image:
                # A follower that lags keeps its run: the image before this one stays.
                self._log.remove(self._kept_after + 1)
                self._kept_after = self._image_after

    def _append(
        self, kind: Kind, pieces: list[bytes], *, part: int = 0, is_more: bool = False
    ) -> None:
        try:
            self._last = self._log.append(kind, pieces, self._last, part=part, is_more=is_more)
        except CentralError as error:
            self._error = error
            raise

    def check(self) -> None:
        """Do nothing: each append shows whether this central still leads."""

    def write_now(self) -> None:
        """Append the inputs of the present turn. Raises CentralError."""
        self.flush()

    def next_segment(self, clock: float) -> int:  # noqa: ARG002 - files have it in their heads
        """Return the number of an image of the present state."""
        self.size = 0
        return self._last

    def use_image(self, number: int, previous: int) -> None:  # noqa: ARG002
        """Append an image from its file, turn by turn. It replaces all that led to it."""
        path = self.folder / f"{number:08d}{IMAGE_SUFFIX}"
        try:
            data = path.read_bytes()
            path.unlink()
        except OSError:  # another one follows
            return
        self._image = deque(cut(encode(Image(number, self._epoch, data))))
        self._part, self._image_after = 0, number

    def standbys(self) -> tuple[Standby, ...]:
        """Return the followers that live. Called once a second."""
        now = self._clock()
        self._seconds.append((now, self._last))
        return tuple(
            Standby(sign.member, sign.address, self._seconds_behind(sign.last, now), sign.is_manual)
            for age, sign in sorted(self._log.signs(), key=lambda one: one[1].member)
            if age < GONE and sign.member != self._member  # it may have followed until now
        )

    def _seconds_behind(self, last: int, now: float) -> int:
        """Return how long ago *last* was the last message, rounded down to a value of BEHIND."""
        since = next((at for at, number in self._seconds if number > last), now)
        return max(one for one in BEHIND if one <= now - since)

    def end(self, why: str) -> None:
        """Append the last inputs, and that the run has ended."""
        self._turn.append(Ended(why))
        try:
            self.close()
        except CentralError as error:
            log.error("the run does not end, and a standby continues it: %s", error)  # noqa: TRY400
            raise

    def close(self) -> None:
        """Append the last inputs. Raises CentralError."""
        self._image.clear()
        self.flush()

    def remove(self) -> None:
        """Refuse to continue without the log: the others would continue the run."""
        raise OSError("the log can't be left")

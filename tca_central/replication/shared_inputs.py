"""The leader's log of inputs in a replicated log, in place of files.

An image is appended in pieces, one a turn, so that no turn waits for a whole image.
"""

from collections import deque
from pathlib import Path

from tca_central.errors import CentralError
from tca_central.events import Input
from tca_central.replication.records import Image, encode
from tca_central.replication.shared_log import Deposed, Kind, SharedLog, Sign, cut
from tca_central.shell.input_log import IMAGE_SUFFIX, Ended


class SharedInputs:
    """The inputs of a run that this central leads.

    Args:
        log: The log.
        sign: This central's sign of life.
        epoch: The run.
        folder: A folder for images that are being written.
    """

    def __init__(self, log: SharedLog, sign: Sign, epoch: str, folder: Path) -> None:
        self.folder = folder
        self.size = 0  #: bytes since the newest image
        self._log, self._sign, self._epoch = log, sign, epoch
        self._last = sign.last  #: the last message of the log
        self._turn: list[Input | Ended] = []
        self._image: deque[bytes] = deque()  #: pieces of an image to append
        self._image_after = 0  #: the last message that led to this image
        self._error: CentralError | None = None  #: the first failure; nothing is appended after it

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
            self._append(Kind.IMAGE, [self._image.popleft()], is_more=bool(self._image))
            if not self._image:
                self._log.remove(self._image_after + 1)

    def _append(self, kind: Kind, pieces: list[bytes], *, is_more: bool = False) -> None:
        try:
            self._last = self._log.append(kind, pieces, self._last, is_more=is_more)
        except CentralError as error:
            self._error = error
            raise
        self._log.give_sign(Sign(self._sign.member, self._sign.address, True, self._last))

    def check(self) -> None:
        """Raise Deposed if another central leads, which an idle one would not notice."""
        for seconds, sign in self._log.signs().values():
            is_later = sign.is_leader and sign.last > self._last
            if is_later and sign.member != self._sign.member and seconds < 1:
                self._error = self._error or Deposed(f"central at {sign.address} leads")
                raise self._error

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
        self._image, self._image_after = (
            deque(cut(encode(Image(number, self._epoch, data)))),
            number,
        )

    def end(self, why: str) -> None:
        """Append the last inputs, and that the run has ended."""
        self._turn.append(Ended(why))
        self.close()

    def close(self) -> None:
        """Append the last inputs, and leave the log. Raises CentralError."""
        try:
            if self._error is None:
                self.flush()
        finally:
            self._log.close()

    def remove(self) -> None:
        """Refuse to continue without the log: the others would continue the run."""
        raise OSError("the log can't be left")

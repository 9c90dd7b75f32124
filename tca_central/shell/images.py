"""Images of the state, so that neither the log of inputs nor the time of a restart grows with the
run.

A forked child writes one: central goes on meanwhile. The inputs from then on are in the segment of
the image's number; what is older than the image before is removed.
"""

import contextlib
import gc
import logging
import os
import signal
import warnings
from pathlib import Path

from tca_central.core import Central
from tca_central.image.encoder import encode, may_be_taken
from tca_central.shell.input_log import DRAFT_SUFFIX, IMAGE_SUFFIX, InputLog
from tca_central.shell.log_writer import SEGMENT_BYTES, LogWriter, sync_path

EVENTS_BETWEEN, MOST_BETWEEN = 10_000, 50_000
"""Events after which there is a new image: ten thousand are handled again in a second or two, long
before modules lose patience. Where there are more tasks than that, which make an image dear, it is
as many events as tasks, up to the most.
"""

log = logging.getLogger("tca.central")


class Images:
    """Has an image made when the log of inputs has grown."""

    def __init__(self, inputs: InputLog, facts: LogWriter, known: int = 0, kept: int = 0) -> None:
        """*known*: the number of events that the newest image has; *kept*: the number of its
        segment of inputs.
        """
        self._inputs, self._facts = inputs, facts
        self._known = known
        self._child = 0  #: the process that writes one
        self._number = 0
        self._path = Path()
        self._kept = kept  #: the number of the newest image that is there

    def tend(self, central: Central) -> None:
        """End of a turn."""
        if self._child:
            self._look_after_child()
        elif (
            central.events >= self._known + _between(central) or self._inputs.size >= SEGMENT_BYTES
        ):
            self.take(central)

    def take(self, central: Central) -> None:
        """Begin an image of the state, and a new segment of inputs with it, if that is possible
        now. Raises CentralError.
        """
        if not may_be_taken(central):
            return
        self._known = central.events
        # should the image be damaged, the one before and these lead to the state
        inputs = self._inputs.hand_over()
        self._number = self._inputs.next_segment(central.clock.now)
        # nothing leads to them again when there is an image of what came after them
        facts = self._facts.hand_over()
        self._path = self._inputs.folder / f"{self._number:08d}{IMAGE_SUFFIX}"
        with warnings.catch_warnings():
            # the child uses no other thread's locks
            warnings.simplefilter("ignore", DeprecationWarning)
            try:
                self._child = os.fork()
            except OSError as error:
                log.warning("no image of the state could be taken: %s", error.strerror)
                return
        if not self._child:
            _write_and_exit(central, self._path, [inputs, facts])

    def close(self) -> None:
        """Wait for the child."""
        if self._child:
            self._look_after_child(0)

    def _look_after_child(self, options: int = os.WNOHANG) -> None:
        try:
            child, status = os.waitpid(self._child, options)
        except ChildProcessError:  # whoever started central lets nobody wait for children
            child, status = self._child, not self._path.exists()
        if not child:
            return
        self._child = 0
        if status:
            log.warning(
                "the image of the state that was being taken is not there: its process ended with %d",
                status,
            )
            return
        if self._kept:
            self._inputs.remove(self._kept)
        self._kept = self._number


def _between(central: Central) -> int:
    """Events from one image to the next."""
    return max(EVENTS_BETWEEN, min(len(central.tree.tasks), MOST_BETWEEN))


def _write_and_exit(central: Central, path: Path, before: list[Path]) -> None:
    """In the child: nothing of central's is touched, and nothing of its lines and locks is kept
    open. The logs *before* are on the disk before the image is.
    """
    status = 1
    try:
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # it ends soon
        gc.disable()
        for log in before:
            sync_path(log)
        write_image(encode(central), path)
        status = 0
    except OSError:
        status = 2
    finally:
        os._exit(status)


def write_image(image: bytes, path: Path) -> None:
    """Write an image, all or nothing. Raises OSError."""
    draft = path.with_suffix(DRAFT_SUFFIX)
    file = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
    data = memoryview(image)
    try:
        while data:
            data = data[os.write(file, data) :]
        os.fsync(file)
        draft.rename(path)
    except OSError:
        draft.unlink(missing_ok=True)  # what is half written takes room where there is none
        raise
    finally:
        os.close(file)
    with contextlib.suppress(OSError):
        sync_path(path.parent)

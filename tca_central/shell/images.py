"""Images of the state, which bound the log of inputs and the time of a restart.

A forked child writes each image, while central continues. Later inputs go to the segment with the
image's number. Files older than the previous image are removed.
"""

import contextlib
import gc
import logging
import os
import signal
import warnings
from pathlib import Path

from tca_central.core import Central
from tca_central.image.encoder import can_encode, encode
from tca_central.shell.input_log import DRAFT_SUFFIX, IMAGE_SUFFIX, InputLog
from tca_central.shell.log_writer import SEGMENT_BYTES, LogWriter, sync_path

EVENTS_BETWEEN, MOST_BETWEEN = 10_000, 50_000
"""Events between two images.

Ten thousand events are handled again in a second or two, long before modules give central up. With
more tasks than that an image costs more, so there are as many events as tasks, up to the higher
number.
"""

log = logging.getLogger("tca.central")


class Images:
    """Writes an image whenever the log of inputs has grown enough.

    Args:
    inputs: The run's log of inputs.
    facts: The run's journal.
    known: The number of events in the newest image.
    kept: The number of its segment of inputs; 0: there is no image.
    """

    def __init__(self, inputs: InputLog, facts: LogWriter, known: int = 0, kept: int = 0) -> None:
        self._inputs, self._facts = inputs, facts
        self._known = known
        self._child = 0  #: the process that writes an image; 0: none
        self._number = 0
        self._path = Path()
        self._kept = kept  #: the number of the newest complete image

    def update(self, central: Central) -> None:
        """At the end of a turn: start an image if one is due, or check on the one being written."""
        if self._child:
            self._reap_child()
        elif (
            central.event_count >= self._known + _between(central)
            or self._inputs.size >= SEGMENT_BYTES
        ):
            self.start(central)

    def start(self, central: Central) -> None:
        """Start an image, and a segment of inputs, if possible now. Raises CentralError."""
        if not can_encode(central):
            return
        self._known = central.event_count
        # If the image is damaged, the previous one and these inputs lead to the same state.
        inputs = self._inputs.write_now()
        self._number = self._inputs.next_segment(central.clock.now)
        # No input leads to these facts again once an image of a later state exists.
        facts = self._facts.write_now()
        self._path = self._inputs.folder / f"{self._number:08d}{IMAGE_SUFFIX}"
        with warnings.catch_warnings():
            # Safe with threads: the child uses no lock of another thread.
            warnings.simplefilter("ignore", DeprecationWarning)
            try:
                self._child = os.fork()
            except OSError as error:
                log.warning("no image of the state could be written: %s", error.strerror)
                return
        if not self._child:
            _write_and_exit(central, self._path, [inputs, facts])

    def close(self) -> None:
        """Wait until the image that is being written is complete."""
        if self._child:
            self._reap_child(0)

    def _reap_child(self, options: int = os.WNOHANG) -> None:
        try:
            child, status = os.waitpid(self._child, options)
        except ChildProcessError:  # SIGCHLD is ignored, so the exit status is unknown
            child, status = self._child, not self._path.exists()
        if not child:
            return
        self._child = 0
        if status:
            log.warning(
                "an image of the state was not written: its process ended with %d",
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
    """In the child: write the image after syncing the logs `before`, then exit.

    The child closes all inherited descriptors, so it keeps no socket or lock of central open.
    """
    status = 1
    try:
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the child ends soon anyway
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
    """Write an image completely, or not at all. Raises OSError."""
    draft = path.with_suffix(DRAFT_SUFFIX)
    file = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
    data = memoryview(image)
    try:
        while data:
            data = data[os.write(file, data) :]
        os.fsync(file)
        draft.rename(path)
    except OSError:
        draft.unlink(missing_ok=True)  # free the disk space of the partial image
        raise
    finally:
        os.close(file)
    with contextlib.suppress(OSError):
        sync_path(path.parent)

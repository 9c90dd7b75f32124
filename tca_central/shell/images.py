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
from typing import Protocol

from tca_central.core import Central
from tca_central.events import Input, Standby
from tca_central.image.encoder import can_encode, encode
from tca_central.shell.input_log import DRAFT_SUFFIX, IMAGE_SUFFIX
from tca_central.shell.log_writer import SEGMENT_BYTES, LogWriter, sync_path

EVENTS_BETWEEN, MOST_BETWEEN = 10_000, 50_000
"""The least and the greatest number of events between two images.

A replay of ten thousand events takes a second or two, and modules wait that much longer after a
restart. An image of many tasks costs more. There are therefore at least as many events between two
images as tasks, up to the greatest number.
"""

log = logging.getLogger("tca.central")


class Inputs(Protocol):
    """The log of inputs of one run: files, or a replicated log."""

    folder: Path
    """The folder for images that are being written."""
    size: int
    """Bytes since the newest image."""
    beat: float
    """Seconds without input after which central adds a tick."""

    def add(self, event: Input) -> None:
        """Append an input; ``flush`` writes it."""

    def flush(self) -> None:
        """End a turn: make its inputs as safe as they must be before messages leave.

        Raises CentralError if that fails, or has failed before.
        """

    def check(self) -> None:
        """Raise CentralError if writes would be lost, or if another central leads."""

    def write_now(self) -> Path | None:
        """Write all inputs. Return the file that an image needs on the disk, if there is one."""

    def next_segment(self, clock: float) -> int:
        """Return the number of an image of the present state, at central's time *clock*."""

    def use_image(self, number: int, previous: int) -> None:
        """Use image *number*, which is complete. What led to the *previous* one may go."""

    def standbys(self) -> tuple[Standby, ...] | None:
        """Return the centrals that follow the log; None if none can."""

    def end(self, why: str) -> None:
        """Write all inputs, then that the run has ended, and close the log."""

    def close(self) -> None:
        """Write all inputs, and close the log."""

    def remove(self) -> None:
        """Remove the log, so that the run can't continue. Raises OSError."""


class Images:
    """Writes an image whenever the log of inputs has grown enough.

    Args:
        inputs: The run's log of inputs.
        journal: The run's journal.
        image_events: The number of events that led to the newest image.
        image: The number of the newest image, and of its segment of inputs; 0: none.
    """

    def __init__(
        self, inputs: Inputs, journal: LogWriter, image_events: int = 0, image: int = 0
    ) -> None:
        self._inputs, self._journal = inputs, journal
        #: The number of events that led to the newest image, complete or not.
        self._image_events = image_events
        self._child = 0  #: the process that writes an image; 0: none
        self._number = 0  #: the number of the image that it writes
        self._path = Path()  #: the file of that image
        self._image = image  #: the number of the newest complete image

    def update(self, central: Central) -> None:
        """End a turn: start an image if one is due, or check on the one being written."""
        if self._child:
            self._reap_child()
            return
        events_between = max(EVENTS_BETWEEN, min(len(central.tree.tasks), MOST_BETWEEN))
        new_events = central.event_count - self._image_events
        if new_events >= events_between or self._inputs.size >= SEGMENT_BYTES:
            self.start(central)

    def start(self, central: Central) -> None:
        """Start an image, and a segment of inputs, if possible now. Raises CentralError."""
        if not can_encode(central):
            return
        self._image_events = central.event_count
        # If the image is damaged, the previous one and these inputs lead to the same state.
        inputs = self._inputs.write_now()
        self._number = self._inputs.next_segment(central.clock.now)
        # A replay from the image does not lead to these facts again, so the child syncs them first.
        facts = self._journal.write_now()
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
            _write_and_exit(central, self._path, [inputs, facts] if inputs else [facts])

    def close(self) -> None:
        """Wait until the image that is being written is complete."""
        if self._child:
            self._reap_child(0)

    def _reap_child(self, options: int = os.WNOHANG) -> None:
        """If the child has ended, remove the files that its image replaces, or log its failure."""
        try:
            child, status = os.waitpid(self._child, options)
        except ChildProcessError:  # SIGCHLD is ignored, so the exit status is unknown
            child, status = self._child, not self._path.exists()
        if not child:
            return
        self._child = 0
        if status:
            log.warning("an image of the state was not written: its process ended with %d", status)
            return
        self._inputs.use_image(self._number, self._image)
        self._image = self._number


def _write_and_exit(central: Central, path: Path, logs: list[Path]) -> None:
    """Run the child: sync the files of *logs*, write the image, then exit.

    The child closes all inherited descriptors, so it keeps no socket or lock of central open.
    """
    status = 1
    try:
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the child ends soon anyway
        gc.disable()
        for log_file in logs:
            sync_path(log_file)
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

"""The files of a run: inputs and images for central's recovery, and the journal for users."""

import math
import os

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import Input, Standby
from tca_central.shell.images import Images, Inputs
from tca_central.shell.journal_writer import JournalWriter
from tca_wire.journal.facts import Entry

LEAST_FREE, LEAST_SHARE = 256 << 20, 20
"""A disk is nearly full with fewer free bytes than LEAST_FREE, and less than a twentieth free."""


class RunLog:
    """The files of one run.

    Args:
        journal: The run's journal.
        inputs: The run's log of inputs; None: the run can't continue after a crash.
        image_events: The number of events that led to the newest image.
        image: The number of the newest image; 0: none.
    """

    def __init__(
        self, journal: JournalWriter, inputs: Inputs | None, image_events: int = 0, image: int = 0
    ) -> None:
        self.folder = journal.folder
        self.images = Images(inputs, journal, image_events, image) if inputs is not None else None
        self._journal, self._inputs = journal, inputs

    @property
    def keeps_inputs(self) -> bool:
        """Whether inputs are stored, so that the run can continue after a restart."""
        return self._inputs is not None

    @property
    def beat(self) -> float:
        """Seconds without input after which central adds a tick."""
        return self._inputs.beat if self._inputs is not None else math.inf

    def standbys(self) -> tuple[Standby, ...] | None:
        """Return the centrals that follow a replicated log; None without such a log."""
        return self._inputs.standbys() if self._inputs is not None else None

    def add_input(self, event: Input) -> None:
        """Append an input that is about to be handled."""
        if self._inputs is not None:
            self._inputs.add(event)

    def add_entry(self, entry: Entry) -> None:
        """Append an entry of the journal."""
        self._journal.add(entry)

    def flush(self, central: Central) -> None:
        """End a turn: write the inputs, then the facts to which they led. Raises CentralError."""
        if self._inputs is not None:
            try:
                self._inputs.flush()
            except CentralError:
                self._journal.discard()  # these facts did not happen
                raise
        self._journal.flush()
        if self.images is not None:
            self.images.update(central)

    def check(self) -> None:
        """Raise CentralError if writes would be lost because a file was removed."""
        if self._inputs is not None:
            self._inputs.check()
        self._journal.check()

    def is_nearly_full(self) -> bool:
        """Whether the disk is nearly full."""
        disk = os.statvfs(self.folder)
        free = disk.f_bavail * disk.f_frsize
        return free < LEAST_FREE and disk.f_bavail * LEAST_SHARE < disk.f_blocks

    def end(self, central: Central, why: str, *, is_over: bool) -> None:
        """Write all records and *why* central ends, and close the files. Raises CentralError.

        If *is_over*, the run has ended. Otherwise it may continue at the next start.
        """
        if self.images is not None:
            self.images.close()
        if self._inputs is not None:
            self._inputs.end(why) if is_over else self._inputs.close()
        number, now = central.event_count + 1, central.clock.now
        self._journal.end(number, now, why) if is_over else self._journal.break_off(
            number, now, why
        )

    def abandon(self) -> bool:
        """Remove the inputs, so that no later start of central continues from them.

        This central continues without the files. Return False if the inputs can't be removed.
        """
        try:
            if self._inputs is not None:
                self._inputs.remove()
        except OSError:
            return False
        return True

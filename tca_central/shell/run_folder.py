"""The folder of a run: its journal, inputs and images. An unfinished run continues."""

import logging
import os
from pathlib import Path
from secrets import token_hex
from typing import Protocol

from tca_central.core import Central
from tca_central.errors import disk_error
from tca_central.events import Input
from tca_central.inputs import Adopt
from tca_central.shell.input_log import InputLog
from tca_central.shell.journal_writer import JournalWriter
from tca_central.shell.log_writer import Sync, lock_folder, numbers
from tca_central.shell.recovery import UnfinishedRun, recover, unfinished_segments
from tca_central.shell.run_log import RunLog
from tca_wire.journal.records import SEGMENT_SUFFIX

log = logging.getLogger("tca.central")


class Recorder(Protocol):
    """A server that writes to the folder."""

    log: RunLog | None
    stopping: str  #: why it must end; "" while it runs

    def handle_input(self, event: Input) -> None:
        """Handle an input."""


class RunFolder:
    """A folder that only this central writes to, with the run that it continues.

    Args:
        path: The folder, created if missing.
        is_fresh: Whether to start a new run in any case.
        accept: Whether a run continues in spite of a difference between journal and inputs.
        adopt: Gets each large body of the inputs and images.

    Raises:
        CentralError: The folder is in use or can't be written, or its run can't continue.
    """

    def __init__(
        self, path: Path, *, is_fresh: bool = False, accept: bool = False, adopt: Adopt = bytes
    ) -> None:
        self.path = path
        self._adopt = adopt
        self._lock = lock_folder(path)
        try:
            self.run = self._unfinished_run(is_fresh=is_fresh, accept=accept)
        except OSError as error:
            os.close(self._lock)
            raise disk_error(error, f"journal {error.filename or path}") from None
        except BaseException:
            os.close(self._lock)
            raise
        earlier = ", after earlier runs" if numbers(path, SEGMENT_SUFFIX) else ""
        #: The words after the folder's name in the log.
        self.history = earlier if self.run is None else ", which continues"
        self.central = Central(token_hex(8)) if self.run is None else self.run.central

    def _unfinished_run(self, *, is_fresh: bool, accept: bool) -> UnfinishedRun | None:
        """Recover the folder's unfinished run, or end it if *is_fresh*."""
        segments = unfinished_segments(self.path, accept=accept or is_fresh)
        if not segments:
            return None
        if not is_fresh:
            return recover(self.path, segments, accept=accept, adopt=self._adopt)
        segments[-1].write_end("a new run was started")
        log.warning("starts a new run: the unfinished run, and its tasks, are left as they are")
        return None

    def open(
        self, server: Recorder, sync: Sync, *, keeps_inputs: bool = True, hold: bool = False
    ) -> None:
        """Let a server write to the folder, and continue an unfinished run. Raises CentralError."""
        run, central = self.run, self.central
        inputs = None
        if keeps_inputs:
            clock = central.clock.now if run is not None else None
            inputs = InputLog(self.path, epoch=central.epoch, sync=sync, clock=clock)
            # The journal may be less safe than the inputs, which lead to the same facts again.
            sync = Sync.BATCH if sync is Sync.ALWAYS else sync
        if run is None:
            server.log = RunLog(JournalWriter(self.path, epoch=central.epoch, sync=sync), inputs)
            return
        journal = JournalWriter(
            self.path, epoch=central.epoch, sync=sync, after=run.opened, entry=run.last
        )
        for entry in run.missing:
            journal.add(entry)
        if inputs is not None:
            inputs.first = run.first_segment
        server.log = RunLog(journal, inputs, run.image_events, run.image)
        self._continue_run(server, run, inputs, hold=hold)

    @staticmethod
    def _continue_run(
        server: Recorder, run: UnfinishedRun, inputs: InputLog | None, *, hold: bool
    ) -> None:
        """Have the server handle the restart, and the loss of ended processes."""
        restarted = run.restarted(hold=hold)
        server.handle_input(restarted)
        if restarted.skipped and inputs is not None:
            # If another power cut lost the restart, central would give out the same ids again.
            inputs.make_safe()
        log.warning(
            "continues the unfinished run, which stopped %.1f s ago: "
            "%d inputs replayed, %d connections are awaited%s",
            restarted.away,
            run.inputs,
            len(run.central.restart_pause.awaited),
            "; no task starts until 'tca resume' says so" if hold else "",
        )
        for lost in run.lost_connections():
            server.handle_input(lost)

    def close(self) -> None:
        """Release the folder."""
        os.close(self._lock)

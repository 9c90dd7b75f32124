"""The folder of a run: its journal, its inputs, images of its state. A run that ended without a goodbye goes on."""

import logging
import os
from importlib.metadata import version
from pathlib import Path
from secrets import token_hex

from tca_central.core import Central
from tca_central.shell.images import INPUTS_BETWEEN, Images
from tca_central.shell.input_log import InputLog
from tca_central.shell.journal_writer import JournalWriter
from tca_central.shell.log_writer import Sync, lock_folder, numbers
from tca_central.shell.recovery import UnfinishedRun, recover, unfinished
from tca_central.shell.server import Server
from tca_wire.journal.records import SEGMENT_SUFFIX

log = logging.getLogger("tca.central")


class RunFolder:
    """A folder that this central alone writes to."""

    def __init__(self, path: Path, *, is_fresh: bool = False, accept: bool = False) -> None:
        """With *is_fresh* a new run begins in any case; with *accept* one goes on in spite of a difference. Raises
        CentralError.
        """
        self.path = path
        self._lock = lock_folder(path)
        segments = [] if is_fresh else unfinished(path)
        try:
            self.run: UnfinishedRun | None = recover(path, segments, accept=accept) if segments else None
        except BaseException:
            os.close(self._lock)
            raise
        earlier = ", after earlier runs" if numbers(path, SEGMENT_SUFFIX) else ""
        self.history = earlier if self.run is None else ", which goes on"  #: for people
        self.central = Central(token_hex(8)) if self.run is None else self.run.central

    def open(self, server: Server, sync: Sync, *, keeps_inputs: bool = True, hold: bool = False) -> None:
        """Let a server write there; a run that goes on does so now. Raises CentralError."""
        run, central, release = self.run, self.central, version("tca-central")
        if keeps_inputs:
            clock = None if run is None else central.clock.now
            server.inputs = InputLog(self.path, epoch=central.epoch, version=release, sync=sync, clock=clock)
            server.images = Images(server.inputs)
        own = Sync.BATCH if keeps_inputs and sync is Sync.ALWAYS else sync  # the inputs lead to the same facts again
        if run is None:
            server.journal = JournalWriter(self.path, epoch=central.epoch, version=release, sync=own)
            return
        server.journal = JournalWriter(
            self.path, epoch=central.epoch, version=release, sync=own, after=run.opened, entry=run.last
        )
        for entry in run.missing:
            server.journal.add(entry)
        if server.inputs is not None:
            server.inputs.first = run.first
        restarted = run.restarted(hold=hold)
        server.take(restarted)
        log.warning(
            "goes on with the run that ended without a goodbye %.1f s ago: %d inputs handled again, %d connections are \
awaited%s", restarted.away, run.inputs, len(central.awaited),
            "; no task starts until 'tca resume' says so" if hold else "",
        )  # fmt: skip
        for lost in run.gone():
            server.take(lost)
        if server.images is not None and run.inputs > INPUTS_BETWEEN // 2:
            server.images.take(central)  # should it be killed again soon

    def close(self) -> None:
        """Free the folder."""
        os.close(self._lock)

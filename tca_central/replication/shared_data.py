"""Copies of tasks' large data in a replicated log, so that another machine has them.

They are made and released as those on the disk (kept_data.py). Data of messages with
``journal=True`` are also copied to the disk of the leader.
"""

import contextlib
import logging
from collections.abc import Container
from pathlib import Path

from tca_central.errors import CentralError
from tca_central.replication.shared_log import SharedLog
from tca_central.shell.kept_data import Copy, KeptData
from tca_central.shell.log_writer import Sync
from tca_wire.packets.large import Keep

log = logging.getLogger("tca.central")


class SharedData(KeptData):
    """The copies of one run.

    Args:
        shared: The log.
        folder: The folder of the journal.
        epoch: The run.
        sync: With ``always``, copies of tasks' data are in the log before messages of the same turn
            leave.
    """

    def __init__(self, shared: SharedLog, folder: Path, epoch: str, sync: Sync) -> None:
        super().__init__(folder, epoch, sync)
        self._shared = shared

    def has_copy(self, name: str, keep: Keep) -> bool:
        """Whether a segment needs no other copy."""
        is_shared = not keep & Keep.TASK or name in self.held
        return is_shared and (not keep & Keep.JOURNAL or super().has_copy(name, keep))

    def make(self, one: Copy) -> None:
        """Copy a segment: that of a task to the log, others to the disk. Raises OSError."""
        if one.keep & Keep.JOURNAL:
            super().make(one)
        if one.keep & Keep.TASK:
            with one.path.open("rb") as stream:
                data = stream.read(one.size)
            if len(data) < one.size:
                msg = f"the segment has {len(data):,} of {one.size:,} bytes"
                raise OSError(msg)
            try:
                self._shared.put_body(one.name, data)
            except CentralError as error:
                raise OSError(str(error)) from None
            self.held.add(one.name)

    def remove_copy(self, name: str) -> None:
        """Remove the copy of a task's segment."""
        self._shared.remove_body(name)

    def remove_all_but(self, held: Container[str]) -> None:
        """Remove the copies of tasks' segments whose names are not *held*."""
        self.held.update(self._shared.bodies())
        for name in [name for name in self.held if name not in held]:
            self.release(name)

    def restore(self, name: str, path: Path) -> None:
        """Restore a segment that is missing in the memory, if there is a copy."""
        if (data := self._shared.body(name)) is None:
            super().restore(name, path)
            return
        draft = path.with_name(f"{path.name}.draft")
        try:
            path.parent.mkdir(exist_ok=True, mode=0o700)
            draft.write_bytes(data)
            draft.rename(path)
        except OSError as error:
            draft.unlink(missing_ok=True)
            log.warning("%s: the data of a task can't be restored: %s", path, error)

    def close(self, *, is_over: bool) -> None:
        """Make all copies, and end the thread. If the run *is_over*, no task needs a copy."""
        super().close(is_over=is_over)
        if is_over:
            with contextlib.suppress(CentralError):
                self.remove_all_but(())

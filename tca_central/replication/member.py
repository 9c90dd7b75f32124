"""A central with a replicated log: it follows the leader until it leads itself."""

import logging
import os
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import Restarted
from tca_central.inputs import Adopt
from tca_central.replication.follower import Follower
from tca_central.replication.shared_inputs import SharedInputs
from tca_central.replication.shared_log import SharedLog, Sign
from tca_central.shell.journal_writer import JournalWriter
from tca_central.shell.log_writer import Sync, lock_folder
from tca_central.shell.recovery import GRACE, ended_processes
from tca_central.shell.run_folder import Recorder
from tca_central.shell.run_log import RunLog
from tca_wire.journal.facts import JOURNAL_VERSION, Entry, Opened
from tca_wire.release import release

log = logging.getLogger("tca.central")

SILENT = 1.0
"""Seconds without a sign of life of the leader, after which another central takes over."""


class Member:
    """One central of several with the same log.

    Args:
        shared: The log.
        address: Where modules find this central when it leads.
        folder: The folder for the journal. It may have a journal of an earlier run.
        adopt: Gets each large body.
    """

    def __init__(self, shared: SharedLog, address: str, folder: Path, adopt: Adopt = bytes) -> None:
        self.path = folder
        self.history = ""  #: the words after the folder's name in the log
        self._lock = lock_folder(folder)
        self._log, self._address = shared, address
        self._name = f"{socket.gethostname()}:{os.getpid()}"
        self._journal: JournalWriter | None = None
        self._follower = Follower(shared, self._write, adopt)
        self._since = time.monotonic()
        self._is_asked = False  #: whether a person wants this central to lead
        self._show(is_leader=False)

    @property
    def central(self) -> Central:
        """The state of the run."""
        assert self._follower.central is not None
        return self._follower.central

    def leader(self) -> Sign | None:
        """Return the last sign of life of a leader, unless it is too old."""
        signs = [(seconds, sign) for seconds, sign in self._log.signs().values() if sign.is_leader]
        seconds, sign = min(signs, key=lambda one: one[0], default=(SILENT, None))
        return sign if seconds < SILENT else None

    def begin(self, *, is_fresh: bool) -> None:
        """Lead from the start. Raises CentralError if another central leads."""
        while self._follower.follow(0.05) or time.monotonic() < self._since + SILENT:
            if (leader := self.leader()) is not None:
                msg = (
                    f"the central at {leader.address} ({leader.member}) leads already: "
                    "start this one with 'tca standby'"
                )
                raise CentralError(msg)
        if not self._follower.take_over(self._address, is_fresh=is_fresh):
            msg = "another central has just begun to lead: start this one with 'tca standby'"
            raise CentralError(msg)

    def stand_by(self, is_stopping: Callable[[], bool], *, is_manual: bool = False) -> bool:
        """Follow the leader until it is silent, and lead then. Return False if *is_stopping*.

        With *is_manual* this central waits for ``lead_now``. The run's end ends it, too.
        """
        while not is_stopping() and not self._follower.is_over:
            self._follower.follow(0.1)
            self._show(is_leader=False)
            if self._may_lead(is_manual=is_manual) and self._follower.take_over(self._address):
                return True
        return False

    def _may_lead(self, *, is_manual: bool) -> bool:
        if self._is_asked or is_manual:
            return self._is_asked
        is_early = time.monotonic() < self._since + SILENT or self._follower.away < SILENT
        return not is_early and self.leader() is None

    def lead_now(self) -> None:
        """Lead although another central does, or with a person's consent. A signal may call it."""
        self._is_asked = True

    def _show(self, *, is_leader: bool) -> Sign:
        sign = Sign(self._name, self._address, is_leader, self._follower.last)
        self._log.give_sign(sign)
        return sign

    def _write(self, central: Central, entries: Sequence[Entry]) -> None:
        """Write the entries of a turn that another central has handled."""
        if not entries:
            return
        journal = self._journal
        if journal is None:
            self._journal = journal = self._new_journal(central, entries[0])
        for entry in entries:
            journal.add(entry)
        journal.flush()

    def _new_journal(self, central: Central, first: Entry | None = None) -> JournalWriter:
        """Return the journal of a run, from an entry on."""
        after = first.number - 1 if first is not None else central.event_count
        is_whole = not after
        opened = None if is_whole else Opened(JOURNAL_VERSION, central.epoch, 1, 0.0, release())
        last = Entry(after, first.time if first is not None else central.clock.now, [])
        return JournalWriter(
            self.path, epoch=central.epoch, sync=Sync.BATCH, after=opened, entry=last
        )

    def open(
        self,
        server: Recorder,
        sync: Sync,  # noqa: ARG002 - the servers of the log decide
        *,
        keeps_inputs: bool = True,  # noqa: ARG002 - always
        hold: bool = False,
    ) -> None:
        """Let a server write to the log and the journal, and continue the run."""
        follower, central = self._follower, self.central
        inputs = SharedInputs(self._log, self._show(is_leader=True), central.epoch, self.path)
        journal = self._journal or self._new_journal(central)
        server.log = RunLog(journal, inputs, follower.image_events)
        if follower.term is None or follower.term.is_first:
            return
        away = follower.away
        server.handle_input(Restarted(central.clock.now, away, GRACE, hold))
        awaited = len(central.restart_pause.awaited)
        log.warning(
            "leads now: the log was silent for %.1f s, %d connections are awaited%s",
            away,
            awaited,
            "; no task starts until 'tca resume' says so" if hold else "",
        )
        for lost in ended_processes(central):
            server.handle_input(lost)

    def close(self) -> None:
        """Release the folder."""
        os.close(self._lock)

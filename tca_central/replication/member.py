"""A central with a replicated log: it follows the leader until it leads itself."""

import logging
import math
import os
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import Restarted
from tca_central.replication.follower import Follower
from tca_central.replication.records import ends_run
from tca_central.replication.shared_inputs import SharedInputs
from tca_central.replication.shared_log import Deposed, SharedLog, Sign
from tca_central.shell.journal_writer import JournalWriter
from tca_central.shell.log_writer import Sync, lock_folder
from tca_central.shell.recovery import GRACE, LONGEST_AWAY, ended_processes
from tca_central.shell.run_folder import Recorder
from tca_central.shell.run_log import RunLog
from tca_central.shell.store import Store
from tca_central.shell.written_facts import WrittenFacts, newest_segment
from tca_wire.journal.facts import JOURNAL_VERSION, Entry, Opened
from tca_wire.release import release

log = logging.getLogger("tca.central")

_LOOK_PERIOD = 0.3
SILENT = 1.0
"""Seconds without a message, though the log answers, after which another central may take over.

Without input the leader appends a tick each ``BEAT`` seconds.
"""


class Member:
    """One central of several with the same log.

    Args:
        shared: The log. ``close`` closes it.
        address: Where modules find this central when it leads.
        folder: The folder for the journal. It may have a journal of this run or an earlier one.
        store: The store of large data, not open yet.
        key: The public key with which this central listens; "" without keys.
        clock: Tells the time in seconds. It never jumps.
    """

    def __init__(
        self,
        shared: SharedLog,
        address: str,
        folder: Path,
        store: Store,
        key: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = folder
        self.history = ""  #: the words after the folder's name in the log
        self.shared = shared
        self._lock = lock_folder(folder)
        self._address, self._store = address, store
        self._name = f"{socket.gethostname()}:{os.getpid()}"
        self._journal: JournalWriter | None = None
        self._written = 0  #: the last entry of the journal
        self._epoch = ""  #: the run of the journal
        self._clock = clock
        self._follower = Follower(shared, self._write, store.adopt, key, clock)
        self._away = 0.0  #: seconds without a leader
        self._is_asked = False  #: whether a person wants this central to lead

    @property
    def central(self) -> Central:
        """The state of the run."""
        assert self._follower.central is not None
        return self._follower.central

    def begin(self, *, is_fresh: bool) -> None:
        """Lead from the start. Raises Deposed if another central leads, CentralError."""
        follower, is_all_read = self._follower, False
        last, is_over = self._end()
        if last and is_over:  # its journal is another central's
            follower.skip(last)
        while not is_all_read or (self._is_unfinished and follower.silence < SILENT):
            if not follower.follow(0.1):
                is_all_read = True
            elif is_all_read:
                raise self._already_led(is_fresh=is_fresh)
        # The clocks of computers may differ: the log's age only serves where nothing else is known.
        if not self._take_over(self.shared.age(), is_fresh=is_fresh):
            raise self._already_led(is_fresh=is_fresh)

    def _take_over(self, away: float, *, is_fresh: bool = False) -> bool:
        """Lead from now on, after *away* seconds. Return False if the log has later messages."""
        self._away = min(max(away, 0.0), LONGEST_AWAY)
        return self._follower.take_over(self._address, is_fresh=is_fresh)

    @property
    def _is_unfinished(self) -> bool:
        return self._follower.central is not None and self._follower.ended is None

    def _end(self) -> tuple[int, bool]:
        """Return the last message's number, and whether the log has no unfinished run."""
        last = self.shared.last()
        return last, not last or any(map(ends_run, self.shared.read(last - 1, 1)))

    def _already_led(self, *, is_fresh: bool) -> CentralError:
        term = self._follower.term
        leader = f"the central at {term.address} ({term.member})" if term else "another central"
        if is_fresh:
            return CentralError(f"{leader} leads a run: end it, or leave --fresh out to follow it")
        return Deposed(f"{leader} leads")

    def stand_by(
        self,
        is_stopping: Callable[[], bool],
        *,
        after: float = SILENT,
        has_followed: bool = False,
    ) -> bool:
        """Follow the leader, and lead once it was silent for a time. Return False if *is_stopping*.

        It also leads after ``lead_now``. It starts no run: if there is none, it waits for one. The
        end of the run ends it, too.

        Args:
            is_stopping: Tells whether to end. It is called several times a second.
            after: Seconds of silence; infinite: a person must decide.
            has_followed: Whether this process has followed or led the log's run before.
        """
        follower, self.shared.gives_up = self._follower, is_stopping
        if not self._wait_for_run(is_stopping, has_followed=has_followed):
            return False
        log.info("follows the log; journal in %s", self.path)
        is_manual, is_reported = math.isinf(after), False
        while not is_stopping() and follower.ended is None:
            follower.follow(0.1)
            self.shared.give_sign(Sign(self._name, self._address, follower.last, is_manual))
            if (central := follower.central) is not None:
                self._store.settle(central.registry.modules)
            is_due = self._is_asked or follower.silence >= after
            if is_due and self._is_unfinished and self._take_over(follower.silence):
                return True
            is_silent = follower.silence >= SILENT
            if is_manual and is_silent and not is_reported:
                log.warning("nobody leads: 'kill -USR2 %d' lets this central lead", os.getpid())
            is_reported = is_silent
        if follower.ended is not None:
            log.info("the run has ended: %s", follower.ended.why)
        return False

    def _wait_for_run(self, is_stopping: Callable[[], bool], *, has_followed: bool) -> bool:
        """Wait until the log has an unfinished run. Return False to end instead."""
        is_reported = False
        while not is_stopping():
            last, is_over = self._end()
            if not is_over:
                return True
            if has_followed:
                return False
            if not is_reported:
                log.info(
                    "waits: the log %s has no run; 'tca central --log' begins one", self.shared.name
                )
                is_reported = True
            self.shared.read(last, _LOOK_PERIOD)
        return False

    def lead_now(self) -> None:
        """Lead although another central does, or with a person's consent. A signal may call it."""
        self._is_asked = True

    def _write(self, central: Central, entries: Sequence[Entry]) -> None:
        """Write the entries of a turn that another central has handled."""
        if not entries:
            return
        journal = self._journal_of(central, entries[0])
        for entry in entries:
            if entry.number > self._written:
                journal.add(entry)
        journal.flush()

    def _journal_of(self, central: Central, first: Entry | None = None) -> JournalWriter:
        """Return the journal of a run, which continues with its *first* entry to write."""
        if self._journal is None or self._epoch != central.epoch:
            self._close_journal()
            self._epoch = central.epoch
            before = first.number - 1 if first is not None else central.event_count
            facts = self._facts_before(before)
            if facts is not None:
                opened, last = facts.opened, facts.last
            else:
                opened, last = None, Entry(0, 0.0, [])
                self._written = before
            if opened is None and before:
                opened = Opened(JOURNAL_VERSION, central.epoch, 1, 0.0, release())
                last = Entry(before, first.time if first is not None else central.clock.now, [])
            self._journal = JournalWriter(
                self.path, epoch=central.epoch, sync=Sync.BATCH, after=opened, entry=last
            )
        return self._journal

    def _facts_before(self, before: int) -> WrittenFacts | None:
        """Return this run's journal in the folder, if there is one that reaches entry *before*.

        A shorter one is moved aside: the log has no longer what would complete it.
        """
        newest = newest_segment(self.path)
        if newest is None or newest[1] != self._epoch:
            return None
        facts = WrittenFacts(self.path, self._epoch, before)
        self._written = facts.read_all() or before
        if facts.last.number >= before:
            facts.cut_journal()
            return facts
        WrittenFacts(self.path, self._epoch, 0).move_all_aside()
        log.warning(
            "%s: the journal of this run ended with entry %d, and the log has only what follows "
            "entry %d: the journal was moved aside",
            self.path,
            facts.last.number,
            before,
        )
        return None

    def _close_journal(self) -> None:
        """Close the journal, with the end of its run if that was read."""
        follower, journal = self._follower, self._journal
        if journal is None:
            return
        if follower.ended is not None and follower.central is not None:
            central = follower.central
            journal.end(central.event_count + 1, central.clock.now, follower.ended.why)
        else:
            journal.discard()  # entries that wait belong to inputs that the log has refused
            journal.close()

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
        self.shared.give_sign(None)
        self.shared.gives_up = lambda: bool(server.stopping)
        inputs = SharedInputs(
            self.shared, follower.last, self._name, central.epoch, self.path, self._clock
        )
        server.log = RunLog(self._journal_of(central), inputs, follower.image_events)
        if follower.term is None or follower.term.is_first:
            return
        server.handle_input(Restarted(central.clock.now, self._away, GRACE, hold))
        awaited = len(central.restart_pause.awaited)
        log.warning(
            "leads now: the log was silent for %.1f s, %d connections are awaited%s",
            self._away,
            awaited,
            "; no task starts until 'tca resume' says so" if hold else "",
        )
        for lost in ended_processes(central):
            server.handle_input(lost)

    def close(self) -> None:
        """Close the journal and the log, and release the folder."""
        self._close_journal()
        self.shared.close()
        os.close(self._lock)

"""Follows a replicated log: keeps the state of its run, and the run's journal, up to date.

A follower handles the inputs that the leader has handled, and so has the leader's state. It takes
over by appending a term: that succeeds only if it has read everything.
"""

import os
import socket
import time
from collections.abc import Callable, Sequence
from secrets import token_hex

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import Record
from tca_central.image.decoder import decode
from tca_central.inputs import Adopt, events_of
from tca_central.replication.records import Image, Pieces, Term, Turn, encode
from tca_central.replication.shared_log import Deposed, Kind, SharedLog
from tca_central.shell.input_log import INPUT_VERSION, Ended
from tca_central.shell.replaying import with_spared
from tca_wire.journal.facts import Entry
from tca_wire.packets.headers import PROTOCOL_VERSION
from tca_wire.release import release

Write = Callable[[Central, Sequence[Entry]], None]
"""Writes the entries of a central to a journal."""

STALL = 0.5
"""Seconds that a read may take longer than asked for. Beyond that, the log or this process stalled,
so that the leader may have been unable to append.
"""


class FollowedRunLost(CentralError):
    """The run that was followed can't be followed any more: follow the log from its start."""


class Follower:
    """The state of a log's run, as far as it was read.

    Args:
        log: The log.
        write: Gets the entries of the journal, turn by turn.
        adopt: Gets each large body.
        key: The public key with which this central would listen.
        clock: Tells the time in seconds. It never jumps.
    """

    def __init__(
        self,
        log: SharedLog,
        write: Write,
        adopt: Adopt = bytes,
        key: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.central: Central | None = None  #: None: nothing is known yet
        self.last = 0  #: the last message that was read
        self.term: Term | None = None  #: the newest term
        self.image_events = 0  #: the number of events that led to the image
        self.silence = 0.0  #: seconds for which the log has answered, and had no new message
        self._log, self._write, self._adopt, self._key = log, write, adopt, key
        self._clock = clock
        self._pieces = Pieces()
        self._early: list[Turn] = []  #: turns before the first image
        self.ended: Ended | None = None  #: how the run has ended

    def follow(self, seconds: float) -> bool:
        """Read what follows, within *seconds*. Return whether there was something.

        Raises FollowedRunLost if the log has no more of this run, CentralError.
        """
        began = self._clock()
        messages = self._log.read(self.last, seconds)
        took = self._clock() - began
        self.silence = 0.0 if messages or took > seconds + STALL else self.silence + took
        for message in messages:
            if message.sequence != self.last + 1 and self.central is not None:
                msg = f"messages {self.last + 1} to {message.sequence - 1} of the log were removed"
                raise FollowedRunLost(msg)
            self.last = message.sequence
            record = self._pieces.add(message)
            if isinstance(record, Term):
                self._begin_term(record)
            elif isinstance(record, Turn):
                self._handle(record)
            elif record is not None:
                self._use(record)
        return bool(messages)

    def skip(self, last: int) -> None:
        """Read nothing up to message *last*, with which a run has ended."""
        self.last, self.ended = last, Ended("")

    def take_over(self, address: str, *, is_fresh: bool = False) -> bool:
        """Lead from now on. Return False if the log has later messages: follow it first.

        With *is_fresh* a new run starts even if the last one is unfinished. Raises CentralError.
        """
        is_first = is_fresh or self.ended is not None or self.central is None
        if is_first and not is_fresh and self.last and self.ended is None:
            msg = "the log has the end of a run, without its start or an image: --fresh leaves it"
            raise CentralError(msg)
        epoch = token_hex(8) if is_first or self.central is None else self.central.epoch
        member = f"{socket.gethostname()}:{os.getpid()}"
        term = Term(
            INPUT_VERSION, PROTOCOL_VERSION, release(), epoch, is_first, member, address, self._key
        )
        try:
            self.last = self._log.append(Kind.TERM, [encode(term)], self.last)
        except Deposed:
            return False
        if is_first:
            self._log.remove(self.last)
            self.central, self.image_events = None, 0
        self._begin_term(term)
        return True

    def _begin_term(self, term: Term) -> None:
        if self._key and term.key and term.key != self._key:
            msg = (
                f"the central at {term.address} listens with key {term.key}, and this one with "
                f"{self._key}: copy the keys folder of one machine to the others"
            )
            raise CentralError(msg)
        if term.is_first:
            if self.central is not None and self.ended is None:
                msg = f"the central at {term.address} has started another run (--fresh)"
                raise FollowedRunLost(msg)
            self.central, self.ended = Central(term.epoch), None
            self._early.clear()
        self.term = term

    def _use(self, image: Image) -> None:
        """Begin with the state of an image, if none is known yet."""
        if self.central is not None:
            return
        self.central = decode(image.data, self._adopt)
        self.image_events = self.central.event_count
        early, self._early = self._early, []
        for turn in early:
            if turn.sequence > image.after:
                self._handle(turn)

    def _handle(self, turn: Turn) -> None:
        central = self.central
        if central is None:
            self._early.append(turn)
            return
        inputs = [one for one in turn.inputs if not isinstance(one, Ended)]
        entries = []
        for logged, spared in with_spared(iter(inputs)):
            for event in events_of(logged, spared, self._adopt):
                entries += [one.entry for one in central.handle(event) if isinstance(one, Record)]
        self._write(central, entries)
        last = turn.inputs[-1]
        self.ended = last if isinstance(last, Ended) else None

"""Processors as threads. The one that has the baton ticks one activity, or waits until the next is
due. Then it hands the baton to the processor that the schedule names.
"""

import contextlib
import threading
import time
from collections.abc import Iterable, Iterator

from tca_behaviours.activities.processing.schedule import Processor, Schedule
from tca_behaviours.activities.processing.ticking import tick
from tca_module import MisuseError
from tca_module.log import log_of

_LOG = log_of("activities")
_GIVE_WAY = 0.0001  # seconds between two threads that are started: a lock that is let go and taken again lets nobody in
_PATIENCE = 2.0  # seconds that stop() waits for a tick without a word


class ActivityProcessor:
    """A processor's thread."""

    def __init__(self, baton: "Baton", processor: Processor) -> None:
        self.processor = processor
        self.turn = threading.Condition(baton.lock)
        self.thread = threading.Thread(
            target=baton.work, args=[self], name=f"processor {processor.name}", daemon=True
        )


class Baton:
    """Runs a schedule: each processor has a thread, and one at a time has the baton."""

    def __init__(self) -> None:
        self.schedule = Schedule()
        self.lock = threading.RLock()
        self.is_running = False
        self._threads: dict[Processor, ActivityProcessor] = {}
        self._leaving: list[threading.Thread] = []
        self._holder: ActivityProcessor | None = None

    def clock(self) -> float:
        """The time by which activities are due."""
        return time.monotonic()

    @contextlib.contextmanager
    def changing(self) -> Iterator[Schedule]:
        """A block that changes the schedule, while it runs too. A tick goes on meanwhile; the next
        begins after it.
        """
        with self.lock:
            try:
                yield self.schedule
            finally:
                self.schedule.change_order()
                if self.is_running:
                    self._match_threads()
                    self._hand_on()

    def ready(self, names: Iterable[str]) -> dict[str, Processor]:
        """Those of the processors that are not there yet, with their threads: started before the
        change that wants them, and one by one, so that ticks need not wait.
        """
        made = {}
        for name in names:
            with self.lock:
                if self.schedule.processor(name) is not None:
                    continue
                made[name] = Processor(name, self.clock())
                if not self.is_running:
                    continue
                self._start_thread(made[name])
            time.sleep(_GIVE_WAY)
        return made

    def start(self) -> None:
        """Begin to tick: all activities are due."""
        for thread in self._leaving:
            if thread is threading.current_thread():
                raise MisuseError(
                    "start() is not for the activity that has just called stop(): use another thread"
                )
            thread.join()
        with self.lock:
            self._leaving.clear()
            if not self.is_running:
                self.is_running = True
                self.schedule.start(self.clock())
                self._match_threads()
                self._hand_on()

    def stop(self) -> None:
        """Tick no more. A tick that runs is waited for, unless it calls this itself."""
        with self.lock:
            self.is_running = False
            for each in list(self._threads.values()):
                self._dismiss(each)
        for thread in self._leaving:
            if thread is not threading.current_thread():
                thread.join(_PATIENCE)
                if thread.is_alive() and (one := self.schedule.ticked):
                    _LOG.warning("stop() waits for a tick of activity '%s'", one.name)
                thread.join()

    def work(self, mine: ActivityProcessor) -> None:
        """The life of a thread."""
        with self.lock:
            while self._wait_for_turn(mine):
                one = self.schedule.begin(mine.processor, self.clock())
                self.lock.release()
                try:
                    error = tick(one.activity)
                finally:
                    self.lock.acquire()
                self.schedule.end(self.clock(), error)
            if self.is_running and self._holder is mine:  # it was dismissed while it ticked
                self._hand_on()

    def _wait_for_turn(self, mine: ActivityProcessor) -> bool:
        """Until an activity of this processor is to be ticked; False: it has been dismissed."""
        while self._threads.get(mine.processor) is mine:
            if self._holder is not mine:
                mine.turn.wait()
                continue
            now = self.clock()
            turn = self.schedule.next_turn(now)
            if turn is None or turn.processor is not mine.processor:
                self._hand_on()  # by then it may be the turn of this processor again
            elif turn.at <= now:
                return True
            else:
                mine.turn.wait(turn.at - now)
        return False

    def _hand_on(self) -> None:
        """Between ticks: give the baton to the processor that is next."""
        if self.schedule.ticked is None:
            turn = self.schedule.next_turn(self.clock())
            self._holder = self._threads[turn.processor] if turn else None
            if self._holder is not None:
                self._holder.turn.notify()

    def _match_threads(self) -> None:
        """A thread for each processor, and none for those that are gone."""
        self._leaving = [thread for thread in self._leaving if thread.is_alive()]
        for processor in set(self._threads) - set(self.schedule.processors):
            self._dismiss(self._threads[processor])
        for processor in self.schedule.processors:
            if processor not in self._threads:
                self._start_thread(processor)

    def _start_thread(self, processor: Processor) -> None:
        self._threads[processor] = ActivityProcessor(self, processor)
        self._threads[processor].thread.start()

    def _dismiss(self, each: ActivityProcessor) -> None:
        del self._threads[each.processor]
        self._leaving.append(each.thread)
        each.turn.notify()

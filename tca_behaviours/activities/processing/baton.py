"""Processors as threads, which pass a baton.

The processor that has the baton ticks one activity, or waits until the next one is due. Then it
passes the baton to the processor that the schedule names.
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
# Seconds between the starts of two threads. Without a pause, prepare() would acquire the lock again
# before any waiting thread could get it.
_START_PAUSE = 0.0001
_PATIENCE = 2.0  # seconds that stop() waits for a tick before it warns


class ProcessorThread:
    """The thread of a processor."""

    def __init__(self, baton: "Baton", processor: Processor) -> None:
        self.processor = processor
        self.condition = threading.Condition(baton.lock)
        self.thread = threading.Thread(
            target=baton.work, args=[self], name=f"processor {processor.name}", daemon=True
        )


class Baton:
    """Runs a schedule: each processor has a thread, and one thread at a time has the baton."""

    def __init__(self) -> None:
        self.schedule = Schedule()
        self.lock = threading.RLock()
        self.is_running = False
        self._threads: dict[Processor, ProcessorThread] = {}
        self._dismissed: list[threading.Thread] = []
        self._holder: ProcessorThread | None = None

    def clock(self) -> float:
        """Return the time by which activities are due."""
        return time.monotonic()

    @contextlib.contextmanager
    def changing(self) -> Iterator[Schedule]:
        """A block that changes the schedule, also while it runs.

        A running tick continues; the next tick begins after the block.
        """
        with self.lock:
            try:
                yield self.schedule
            finally:
                self.schedule.update_order()
                if self.is_running:
                    self._match_threads()
                    self._hand_on()

    def prepare(self, names: Iterable[str]) -> dict[str, Processor]:
        """Create the processors that do not exist yet. While the schedule runs, also start their
        threads.

        The threads start one by one, before the change that needs them. So no tick waits for all of
        them.
        """
        created = {}
        for name in names:
            with self.lock:
                if self.schedule.processor(name) is not None:
                    continue
                created[name] = Processor(name, self.clock())
                if not self.is_running:
                    continue
                self._start_thread(created[name])
            time.sleep(_START_PAUSE)
        return created

    def start(self) -> None:
        """Start to tick; all activities are due."""
        for thread in self._dismissed:
            if thread is threading.current_thread():
                raise MisuseError(
                    "start() was called from the tick that called stop(): use another thread"
                )
            thread.join()
        with self.lock:
            self._dismissed.clear()
            if not self.is_running:
                self.is_running = True
                self.schedule.start(self.clock())
                self._match_threads()
                self._hand_on()

    def stop(self) -> None:
        """Stop ticking, and wait for the end of a running tick. If that tick calls ``stop`` itself,
        do not wait.
        """
        with self.lock:
            self.is_running = False
            for each in list(self._threads.values()):
                self._dismiss(each)
        for thread in self._dismissed:
            if thread is not threading.current_thread():
                thread.join(_PATIENCE)
                if thread.is_alive() and (activity := self.schedule.ticked):
                    _LOG.warning("stop() waits for a tick of activity '%s'", activity.name)
                thread.join()

    def work(self, own: ProcessorThread) -> None:
        """Tick the activities of one processor until it is dismissed. Runs in its thread."""
        with self.lock:
            while self._wait_for_turn(own):
                activity = self.schedule.begin(own.processor, self.clock())
                self.lock.release()
                try:
                    error = tick(activity.activity)
                finally:
                    self.lock.acquire()
                self.schedule.end(self.clock(), error)
            if self.is_running and self._holder is own:  # dismissed during its tick
                self._hand_on()

    def _wait_for_turn(self, own: ProcessorThread) -> bool:
        """Wait until an activity of this processor must be ticked. False if the processor was
        dismissed.
        """
        while self._threads.get(own.processor) is own:
            if self._holder is not own:
                own.condition.wait()
                continue
            now = self.clock()
            turn = self.schedule.next_turn(now)
            if turn is None or turn.processor is not own.processor:
                self._hand_on()  # perhaps to this processor again
            elif turn.at <= now:
                return True
            else:
                own.condition.wait(turn.at - now)
        return False

    def _hand_on(self) -> None:
        """Pass the baton to the next processor, unless a tick is running."""
        if self.schedule.ticked is None:
            turn = self.schedule.next_turn(self.clock())
            self._holder = self._threads[turn.processor] if turn else None
            if self._holder is not None:
                self._holder.condition.notify()

    def _match_threads(self) -> None:
        """Start and dismiss threads, so that each processor of the schedule, and no other, has
        one.
        """
        self._dismissed = [thread for thread in self._dismissed if thread.is_alive()]
        for processor in set(self._threads) - set(self.schedule.processors):
            self._dismiss(self._threads[processor])
        for processor in self.schedule.processors:
            if processor not in self._threads:
                self._start_thread(processor)

    def _start_thread(self, processor: Processor) -> None:
        self._threads[processor] = ProcessorThread(self, processor)
        self._threads[processor].thread.start()

    def _dismiss(self, each: ProcessorThread) -> None:
        del self._threads[each.processor]
        self._dismissed.append(each.thread)
        each.condition.notify()

"""The goal under which the tasks of a mission stand. With it they end, whatever becomes of the mission's process."""

import contextlib
import itertools
import os
import queue
import traceback

import msgspec

from tca_module import (
    HANDLERS_CHANGED,
    ExceptionHandler,
    Failure,
    Goal,
    HandlerCount,
    LaterReply,
    MisuseError,
    Module,
    Recovery,
    Scope,
    Sender,
    Stopped,
    Task,
    TaskKilled,
    TaskRef,
    TcaError,
)
from tca_module.link.opening import CentralAddress

MISSION_FAILED = Failure("mission failed")
"""The failure of a mission that an exception has ended; the text says which."""

_ENDS_WITHIN = 5.0  # seconds that central may take to end the mission's goal
_numbers = itertools.count(1)


class MissionInfo(msgspec.Struct, frozen=True):
    """The data of a mission's goal."""

    server: str
    process: int


class MissionGoal:
    """A module of the mission's own, and a goal that it handles until the mission ends.

    When the process dies the goal fails with "module lost", and central kills what is under it. Failures of the tasks
    are dealt with here: the mission gets them as exceptions, and decides.
    """

    def __init__(self, name: str, server: str, central: CentralAddress, under: Task | None, *, stays: bool) -> None:
        """*under*: the tasks belong to that task, and need no goal of their own. *stays*: nor do those that are to go
        on when the mission has ended.
        """
        number = next(_numbers)
        self._name = f"mission {name} {os.getpid()}" + (f".{number}" if number > 1 else "")
        self._message = Goal(self._name, MissionInfo)
        self._deal = ExceptionHandler(f"{self._name}: failure")
        self._module = Module(self._name, central)
        self._server = server
        self._under, self._stays = under, stays
        self._begun = queue.SimpleQueue[LaterReply[None]]()
        self._owed: LaterReply[None] | None = None
        self._top: TaskRef | None = under.ref if under is not None else None
        self._texts: dict[int, str] = {}
        self._stack = contextlib.ExitStack()
        self.lost = set[str]()  #: messages that were handled, and are not any more
        self.changes = 0  #: grows when central has told of handlers that came or went

    def open(self) -> None:
        """Join central, and begin the goal. Raises CentralLost."""
        module = self._module
        module.handles(self._message)(self._begin)
        module.handles(self._deal, resource="failures")(self._deal_with)
        module.handles(HANDLERS_CHANGED, resource="failures")(self._note_handlers)
        self._stack.enter_context(module.running())
        if self._under is not None:
            self._stack.callback(self._under.ref.on_failure(None, self._deal).remove)
        elif self._stays:
            self._stack.enter_context(module.parallel())  # no task of it waits for the one before
        else:
            recovery = Recovery(None, self._deal)
            info = MissionInfo(self._server, os.getpid())
            self._top = module.goal(self._message, info, sequential=False, on_failure=[recovery])
            self._owed = self._begun.get()

    @property
    def sender(self) -> Sender:
        """The sender of the mission's thread."""
        return self._under or self._module

    def below(self) -> Sender:
        """A sender for one more task of the mission."""
        return self.sender.under(self._top) if self._top is not None else self.sender

    def check(self, *, ask: bool = False) -> None:
        """Raise TaskKilled if somebody has killed the goal, which ends the mission. *ask*: this thread may hear of a
        task's end before another one hears of the goal's; so ask central.
        """
        if self._owed is None or self._top is None or not (ask or self._owed.cancelled):
            return
        info = self._top.info()
        if info is None or info.killed:
            raise TaskKilled(str(self._top), info.killed if info is not None else "see the journal")

    def close(self, error: BaseException | None) -> None:
        """End the goal, as done or, with the exception that has ended the mission, as failed; and leave central."""
        with self._stack:
            if self._owed is None or self._top is None:
                return
            with contextlib.suppress(TcaError):
                self._top.kill("the mission has ended", scope=Scope.DESCENDANTS)
            with contextlib.suppress(Stopped, MisuseError):
                if error is None:
                    self._owed.reply()
                else:
                    text = "".join(traceback.format_exception_only(error)).strip()
                    self._owed.fail(MISSION_FAILED(text=text.partition("\n")[0]))
            with contextlib.suppress(TcaError):
                self._top.wait(_ENDS_WITHIN)

    def take_text(self, task: int) -> str:
        """The text of the failure of a task; "" if none was heard."""
        return self._texts.pop(task, "")

    # --- handlers: they run in threads of the module ------------------------------------------------------------------

    def _begin(self, task: Task, _: MissionInfo) -> LaterReply[None]:
        later = task.reply_later()
        self._begun.put(later)
        return later

    def _deal_with(self, task: Task) -> None:
        """A task of the mission has failed: the mission's own program decides what comes of that."""
        trouble = task.trouble
        if self._top is not None and trouble.failing.id == self._top.id:
            raise trouble.reissue()
        self._texts[trouble.failing.id] = trouble.text

    def _note_handlers(self, _: Task, count: HandlerCount) -> None:
        if count.handlers:
            self.lost.discard(count.message)
        else:
            self.lost.add(count.message)
        self.changes += 1

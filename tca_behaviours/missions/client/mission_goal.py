"""The goal under which the tasks of a mission stand. With it they end, whatever becomes of the
mission's process.
"""

import contextlib
import itertools
import os
import traceback

import msgspec

from tca_module import (
    HANDLERS_CHANGED,
    CentralLost,
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
    wait_for_any,
)
from tca_module.link.opening import CentralAddress

MISSION_FAILED = Failure("mission failed")
"""The failure of a mission that an exception has ended; the text says which."""

_ENDS_WITHIN = 5.0  # seconds that central may take to end the mission's goal
_numbers = itertools.count(1)
_Begun = tuple[int, LaterReply[None]]
"""A goal that has begun: its task's number, and the reply that ends it."""

_TOGETHER = "two missions of one name have begun at the same moment"


class MissionInfo(msgspec.Struct, frozen=True):
    """The data of a mission's goal."""

    server: str


class _NameTakenError(Exception):
    """Another mission of that name runs."""


def _wait_for_begin(goal: TaskRef, begun: list[_Begun]) -> LaterReply[None]:
    """Wait for the mission's own goal to begin. Returns the reply it owes."""
    if wait_for_any([goal], until=lambda: bool(begun)) or not begun:
        raise _NameTakenError  # another mission of the same name got the goal, and refused it
    task, owed = begun[0]
    if task != goal.id:
        owed.fail(MISSION_FAILED(text=_TOGETHER))
        raise _NameTakenError
    return owed


class MissionGoal:
    """A module of the mission's own, and a goal that it handles until the mission ends.

    When the process dies the goal fails with "module lost", and central kills what is under it. A
    task that fails is killed here, and so stays *failed*: the mission gets that as an exception,
    and decides what comes next.
    """

    def __init__(
        self, name: str, server: str, central: CentralAddress, under: Task | None, *, stays: bool
    ) -> None:
        """*under*: the tasks belong to that task, and need no goal of their own. *stays*: nor do
        those that are to go on when the mission has ended.
        """
        self._title = f"mission {name}"
        self._central = central
        self._server = server
        self._under, self._stays = under, stays
        self._owed: LaterReply[None] | None = None
        self._top: TaskRef | None = None
        self._stack = contextlib.ExitStack()
        self.lost = set[str]()  #: messages that were handled, and are not any more
        self.changes = 0  #: grows when central has told of handlers that came or went

    def open(self) -> None:
        """Join central, and begin the goal. Raises CentralLost."""
        try:
            self._open(self._title)
        except _NameTakenError:
            self._open(f"{self._title} {os.getpid()}.{next(_numbers)}")

    def _open(self, name: str) -> None:
        """Join as a mission of that name. Raises _NameTakenError if another mission has it, or
        takes it as well.
        """
        self._module = module = Module(name, self._central)
        begun: list[_Begun] = []  # of this attempt only: the next one's goal is another
        goal, deal = Goal(name, MissionInfo), ExceptionHandler(f"{name}: failure")

        def check_name(_: Module) -> None:
            if module.handlers(deal):
                raise _NameTakenError

        def begin(task: Task, _: MissionInfo) -> LaterReply[None]:
            begun.append(mine := (task.id, task.reply_later()))
            if begun[0] is not mine:
                raise MISSION_FAILED(text=_TOGETHER)
            return mine[1]

        module.at_start(check_name)
        module.resource(
            "goals", capacity=2
        )  # a second goal is refused, where it would wait for the end of this one
        module.handles(goal, resource="goals")(begin)
        module.handles(deal, resource="failures")(self._deal_with)
        module.handles(HANDLERS_CHANGED, resource="failures")(self._note_handlers)
        with contextlib.ExitStack() as stack:
            stack.enter_context(module.running())
            if self._under is not None:
                self._top = self._under.ref
                stack.callback(self._top.on_failure(None, deal).remove)
            elif self._stays:
                stack.enter_context(module.parallel())  # no task of it waits for the one before
            else:
                info = MissionInfo(self._server)
                self._top = top = module.goal(
                    goal, info, sequential=False, on_failure=[Recovery(None, deal)]
                )
                self._owed = _wait_for_begin(top, begun)
            self._stack = stack.pop_all()

    @property
    def name(self) -> str:
        """The name by which central knows the mission, without "mission": no other mission has it
        now.
        """
        return self._module.name.removeprefix("mission ")

    @property
    def sender(self) -> Sender:
        """The sender of the mission's thread."""
        return self._under or self._module

    def below(self) -> Sender:
        """A sender for one more task of the mission."""
        return self.sender.under(self._top) if self._top is not None else self.sender

    def check(self, *, ask: bool = False) -> None:
        """Raise TaskKilled if somebody has killed the goal, which ends the mission. *ask*: this
        thread may hear of a task's end before another one hears of the goal's; so ask central.
        """
        if self._owed is None or self._top is None or not (ask or self._owed.cancelled):
            return
        info = self._top.info()
        if info is None or info.killed:
            raise TaskKilled(str(self._top), info.killed if info is not None else "see the journal")

    def close(self, error: BaseException | None, *, waits: bool = True) -> None:
        """End the goal, as done or, with the exception that has ended the mission, as failed; and
        leave central. It *waits* for the end, unless something below is known not to end.
        """
        with self._stack:
            if self._owed is None or self._top is None or isinstance(error, CentralLost):
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
                self._top.wait(_ENDS_WITHIN if waits else 0.0)

    # --- handlers: they run in threads of the module ----------------------------------------------

    def _deal_with(self, task: Task) -> None:
        """A task of the mission, or one under it, has failed: that ends the mission's task, but not
        the mission.
        """
        trouble, failing, top = task.trouble, task.trouble.failing, self._top
        if top is None or failing.id == top.id:
            raise trouble.reissue()
        # Killed and not resolved, because a task that is killed after a failure counts as failed
        # everywhere.
        failing.kill("it has failed, and the mission continues")
        above = list(itertools.takewhile(lambda one: one.id != top.id, failing.ancestors()))
        if above:  # the mission's task is to it as a top-level task is to central
            above[-1].fail(Failure(trouble.failure)(text=f"in {failing}: {trouble.text}"))

    def _note_handlers(self, _: Task, count: HandlerCount) -> None:
        if count.handlers:
            self.lost.discard(count.message)
        else:
            self.lost.add(count.message)
        self.changes += 1

"""The goal above all tasks of a mission.

When the mission's process dies, its goal fails, and central kills the tasks below it.
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
_numbers = itertools.count(1)  # make the names of this process's missions unique
_Begun = tuple[int, LaterReply[None]]
"""A goal that has begun: the number of its task, and the reply that ends it."""

_SAME_TIME = "two missions of one name began at the same time"


class MissionInfo(msgspec.Struct, frozen=True):
    """The data of a mission's goal."""

    server: str


class _NameTakenError(Exception):
    """Another mission of that name is running."""


def _wait_for_begin(goal: TaskRef, begun: list[_Begun]) -> LaterReply[None]:
    """Wait until the mission's own *goal* begins. Returns the later reply that will end it.

    Raises _NameTakenError if another mission of the same name has got the goal.
    """
    if wait_for_any([goal], until=lambda: bool(begun)) or not begun:
        raise _NameTakenError  # the other mission has refused this goal
    task, reply = begun[0]
    if task != goal.id:  # this mission has got the other mission's goal
        reply.fail(MISSION_FAILED(text=_SAME_TIME))
        raise _NameTakenError
    return reply


class MissionGoal:
    """The module of a mission, and the goal that it handles until the mission ends.

    When the process dies, the goal fails with "module lost", and central kills the tasks below it.
    The module also handles the failures of the mission's tasks: it kills a task that fails. The
    outcome of that task is *failed*. The mission gets an exception, and the program decides what
    to do.
    """

    def __init__(
        self,
        name: str,
        server: str,
        central: CentralAddress,
        under: Task | None,
        *,
        leave_running: bool,
    ) -> None:
        """Create the goal; ``open`` sends it.

        Args:
            name: the mission's name.
            server: the server whose tasks it runs.
            central: the address of central.
            under: the task that the mission's tasks belong to. Then the mission needs no goal of
                its own.
            leave_running: whether the tasks outlive the mission. Then they stand at the top of the
                tree, without a goal above them.
        """
        self._title = f"mission {name}"
        self._central = central
        self._server = server
        self._under, self._leave_running = under, leave_running
        self._reply: LaterReply[None] | None = None
        self._top: TaskRef | None = None  # the task above all tasks of the mission
        self._stack = contextlib.ExitStack()
        self.lost_messages = set[str]()  #: the names of messages that have lost their last handler
        self.handler_changes = 0  #: the number of changes of handlers that central has reported

    def open(self) -> None:
        """Join central, and begin the goal. Raises CentralLost."""
        try:
            self._open(self._title)
        except _NameTakenError:
            self._open(f"{self._title} {os.getpid()}.{next(_numbers)}")

    def _open(self, name: str) -> None:
        """Join central as a mission of that name.

        Raises _NameTakenError if another mission has the name, or claims it at the same time.
        """
        self._module = module = Module(name, self._central)
        begun: list[_Begun] = []  # of this attempt only: the next attempt sends another goal
        goal, failure_handler = Goal(name, MissionInfo), ExceptionHandler(f"{name}: failure")

        def check_name(_: Module) -> None:
            if module.handlers(failure_handler):
                raise _NameTakenError

        def begin(task: Task, _: MissionInfo) -> LaterReply[None]:
            begun.append(own := (task.id, task.reply_later()))
            if begun[0] is not own:
                raise MISSION_FAILED(text=_SAME_TIME)
            return own[1]

        module.at_start(check_name)
        # With one slot a second goal would wait for the end of the first. With two slots ``begin``
        # gets the second goal and refuses it.
        module.resource("goals", capacity=2)
        module.handles(goal, resource="goals")(begin)
        module.handles(failure_handler, resource="failures")(self._handle_failure)
        module.handles(HANDLERS_CHANGED, resource="failures")(self._update_handlers)
        with contextlib.ExitStack() as stack:
            stack.enter_context(module.running())
            if self._under is not None:
                self._top = self._under.ref
                stack.callback(self._top.on_failure(None, failure_handler).remove)
            elif self._leave_running:
                stack.enter_context(module.parallel())  # no task waits for the task sent before
            else:
                info = MissionInfo(self._server)
                self._top = top = module.goal(
                    goal, info, sequential=False, on_failure=[Recovery(None, failure_handler)]
                )
                self._reply = _wait_for_begin(top, begun)
            self._stack = stack.pop_all()

    @property
    def name(self) -> str:
        """The mission's name in central, without "mission". No other running mission has it."""
        return self._module.name.removeprefix("mission ")

    @property
    def sender(self) -> Sender:
        """The sender for the mission's thread."""
        return self._under or self._module

    def below(self) -> Sender:
        """Return a sender whose tasks hang below the mission's goal."""
        return self.sender.under(self._top) if self._top is not None else self.sender

    def raise_if_killed(self, *, ask: bool = False) -> None:
        """Raise TaskKilled if the goal was killed, which ends the mission.

        With *ask*, always ask central: this thread may learn of the end of a task before the
        goal's own thread learns of the kill.
        """
        if self._reply is None or self._top is None or not (ask or self._reply.cancelled):
            return
        info = self._top.info()
        if info is None or info.killed:
            lost = "it has ended, perhaps as its process was silent too long: see the journal"
            raise TaskKilled(str(self._top), info.killed if info is not None else lost)

    def close(self, error: BaseException | None, *, waits: bool = True) -> None:
        """End the goal and leave central.

        Args:
            error: the exception that has ended the mission, which fails the goal; None: the goal is
                done. After a KeyboardInterrupt the goal is killed.
            waits: whether to wait for the end of the goal. Don't if a task below it is known to
                hang.
        """
        with self._stack:
            if self._reply is None or self._top is None or isinstance(error, CentralLost):
                return
            is_stopped = isinstance(error, KeyboardInterrupt)
            with contextlib.suppress(TcaError):
                if is_stopped:
                    self._top.kill("the mission was ended by Ctrl-C")
                else:
                    self._top.kill("the mission has ended", scope=Scope.DESCENDANTS)
            with contextlib.suppress(Stopped, MisuseError):
                if error is None or is_stopped:
                    self._reply.reply()
                else:
                    text = "".join(traceback.format_exception_only(error)).strip()
                    self._reply.fail(MISSION_FAILED(text=text.partition("\n")[0]))
            with contextlib.suppress(TcaError):
                self._top.wait(_ENDS_WITHIN if waits else 0.0)

    # --- handlers: they run in threads of the module ----------------------------------------------

    def _handle_failure(self, task: Task) -> None:
        """End a task of the mission after a failure in it or below it. The mission continues."""
        trouble, failing, top = task.trouble, task.trouble.failing, self._top
        if top is None or failing.id == top.id:
            raise trouble.reissue()
        # Kill the task rather than resolve the failure, so that the task counts as failed.
        failing.kill("it has failed, and the mission continues")
        ancestors = list(itertools.takewhile(lambda task: task.id != top.id, failing.ancestors()))
        if ancestors:  # the failing task is below a task of the mission: fail that task, too
            ancestors[-1].fail(Failure(trouble.failure)(text=f"in {failing}: {trouble.text}"))

    def _update_handlers(self, _: Task, count: HandlerCount) -> None:
        if count.handlers:
            self.lost_messages.discard(count.message)
        else:
            self.lost_messages.add(count.message)
        self.handler_changes += 1

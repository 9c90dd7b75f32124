"""Who acts in a run: scripts under way (actors), the connections that they act on (lines), and the runs of modules."""

from tca_explorer.errors import ScenarioError
from tca_explorer.marks import Number
from tca_explorer.scenario import ScenarioModule
from tca_explorer.script import CANCELLED, Program
from tca_explorer.steps import OWN, Branch, Got, History, Step, place_of
from tca_wire.constraints import Constraint
from tca_wire.points import THIS, Point, TaskId


class Actor:
    """A script under way."""

    def __init__(self, program: Program, body: bytes, delivery: int = 0, task: TaskId = TaskId(0)) -> None:  # noqa: B008
        self.program = program
        self.body = body
        self.delivery = delivery  #: that it handles; 0: none, a module does this by itself
        self.task = task  #: that it handles; 0: none
        self.history: History = ()
        self.sent: list[TaskId] = []  #: the tasks that it sent
        self.step: Step | None = None  #: that it is waiting to get something for
        self.number = Number(0)  #: of the request that it waits for
        self.bodies: tuple[bytes, ...] = ()  #: what has come of several answers
        self.is_told = False  #: that its task was killed
        self.refusal = ""  #: what central last said when it refused something
        self.was_told = False  #: the same, when it last got something

    @property
    def branches(self) -> tuple[Branch, ...]:
        """How it may go on. Raises ScenarioError."""
        try:
            return self.program.branches(self.body, self.history)
        except ScenarioError as error:
            raise ScenarioError(f"{error}: central said: {self.refusal}" if self.refusal else str(error)) from error

    def may_take(self, branch: Branch) -> bool:
        """Whether *branch* reads of a kill only what it can have been told."""
        told = [got.choice for got in branch.decisions if got.kind == CANCELLED]
        return (self.is_told or 1 not in told) and (not self.was_told or 0 not in told)

    def get(self, got: Got) -> None:
        """Something came back for its step."""
        self.history = (*self.history, got)
        self.step, self.number, self.bodies = None, Number(0), ()
        self.was_told = self.is_told

    def real(self, task: TaskId) -> TaskId:
        """Central's id of a task that the script names by its place."""
        if task == OWN:
            return self.task
        return self.sent[place_of(task)] if task < OWN else task

    def real_point(self, point: Point) -> Point:
        """A point that the script names, as central knows it."""
        return point if point.task == THIS else Point(self.real(point.task), point.moment)

    def real_constraints(self, constraints: tuple[Constraint, ...]) -> list[Constraint]:
        """Constraints that the script names, as central knows them."""
        return [Constraint(self.real_point(one.before), self.real_point(one.after)) for one in constraints]


class Line:
    """A connection of a module's run to central, and what is being done on it: the last of the stack acts."""

    def __init__(self, name: str, run: "Run") -> None:
        self.name = name
        self.run = run
        self.stack: list[Actor] = []


class Run:
    """One run of a module's program, from its start until its last connection has ended."""

    def __init__(self, module: ScenarioModule, number: int) -> None:
        self.module = module
        self.name = module.name if number == 1 else f"{module.name} run {number}"
        self.lines: list[Line] = []  #: those that central has not seen end; the module's own first
        self.steps_joined = 0
        self.is_alive = True
        self.is_leaving = False

    @property
    def is_joined(self) -> bool:
        """Whether all its connections have been there."""
        return self.steps_joined == self.steps_to_join

    @property
    def steps_to_join(self) -> int:
        """Saying hello; and, where it handles anything, saying what, and a hello for each slot."""
        return 2 + len(self.module.slots) if self.module.formats else 1

    def may_say_goodbye(self) -> list[Line]:
        """Those of its lines that may end now because it leaves: what does nothing, its own line last."""
        if not self.is_leaving:
            return []
        own, *slots = self.lines
        return [line for line in slots if not line.stack] if slots else [own]

    def die(self) -> None:
        """Its process is gone, and with it all that it was doing."""
        self.is_alive = False
        for line in self.lines:
            line.stack.clear()

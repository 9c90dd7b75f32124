"""Which moment of which task may be reached when. Knows points and constraints; nothing of modules or sockets.

Theory of operation. Every point counts the constraints that still hold it (``Task.held``, six counters packed into
one integer); every task lists the points that wait for its own (``Task.followers``). Reaching a moment lowers the
counters of its followers, and whoever's counter falls to zero is looked at again; parents and children are looked at
by the parent/child rules: a child starts planning (achieving) only after its parent has, a parent ends planning
(achieving) only after all its children have. ``settle`` repeats that until nothing moves. Each point is reached once
and each constraint released once, so an event costs what it changes, whatever the size of the tree; nothing recurses.
"""

from collections import deque

from tca_central.cycles import Place, find_path
from tca_central.errors import RequestError
from tca_central.intervals import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    MUST_FOLLOW_IN_COMMAND,
    MUST_FOLLOW_IN_GOAL,
    REACHED_AT_BIRTH_BY_COMMAND,
    SINGLE_MOMENTS,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    STARTS,
    STARTS_OF_COMMAND,
    STARTS_OF_GOAL,
    comes_after,
    delivered_at,
    unified,
)
from tca_central.task_tree import Task, TaskTree
from tca_wire.constraints import (
    Constraint,
    Flags,
    delay_planning,
    plan_first,
    sequential_achievement,
    sequential_planning,
)
from tca_wire.facts import Constrained, Killed, Reached
from tca_wire.headers import Refusal
from tca_wire.points import ALL_MOMENTS, ROOT, THIS, Moment, Point, TaskId

_SEQ_ACH, _SEQ_PLANNING = int(Flags.SEQ_ACH), int(Flags.SEQ_PLANNING)
_PLAN_FIRST, _DELAY_PLANNING = int(Flags.PLAN_FIRST), int(Flags.DELAY_PLANNING)

_BITS = 24  # per counter of ``held``: 16 million constraints on one point
_COUNTER = (1 << _BITS) - 1
_SHIFT = {int(moment): _BITS * i for i, moment in enumerate(Moment)}


class Agenda:
    """The temporal side of the tree. The core takes what comes out: ``startable``, ``ended`` and ``met``."""

    def __init__(self, tree: TaskTree, facts: list[object]) -> None:
        self.tree = tree
        self._facts = facts
        self._look_at: deque[Task] = deque()
        self.startable: deque[Task] = deque()  #: all conditions of their delivery to a handler are met
        self.withdrawn: deque[Task] = deque()  #: were startable, and are held again
        self.ended: deque[Task] = deque()  #: reached their last moment
        self.met: deque[tuple[Task, object]] = deque()  #: waits whose moment has been reached

    # --- what the core tells ---------------------------------------------------------------------------------------

    def add(self, task: Task, parent: Task, flags: Flags, wanted: list[Constraint]) -> list[Constraint]:
        """Hang a new task under *parent*; the constraints put on it, by absolute ids.

        Raises RequestError, and leaves no trace, where a constraint can never be met.
        """
        sender = task.sender.module.name if task.sender else ""
        last = self.tree.last_sibling(parent, sender)
        self.tree.attach(task, parent)
        if not task.is_goal:
            task.reached |= REACHED_AT_BIRTH_BY_COMMAND
        else:
            parent.unplanned += 1
        added: list[Constraint] = []
        try:
            for constraint in _from_flags(flags, task, last):
                added += self._constrain(constraint, check=constraint.before.task == task.id)
            for constraint in wanted:
                added += self._constrain(_resolve(constraint, TaskId(task.id)), check=True)
        except RequestError:
            self._undo(added)
            self.tree.detach(task)
            parent.unplanned -= task.is_goal
            raise
        for constraint in added:
            if constraint.after.task != task.id:
                self._hold_again(self.tree.tasks[constraint.after.task])
        self.tree.become_last(task, sender)
        if parent.killed:
            self.kill(task, parent.killed)
        self._look_at.append(task)
        return added

    def constrain(self, wanted: list[Constraint]) -> list[Constraint]:
        """Add constraints between existing tasks; those that hold anything. All of them or, with RequestError, none."""
        added: list[Constraint] = []
        try:
            for constraint in wanted:
                added += self._constrain(constraint, check=True)
        except RequestError:
            self._undo(added)
            raise
        for constraint in added:
            self._hold_again(self.tree.tasks[constraint.after.task])
        return added

    def started(self, task: Task) -> None:
        """A handler was given the task."""
        if not task.reached & START_HANDLING:
            together = STARTS if task.delayed else STARTS_OF_GOAL if task.is_goal else STARTS_OF_COMMAND
            self._reach(task, together & ~task.reached)
            self._look_at.append(task)

    def returned(self, task: Task) -> None:
        """The task's handler has returned."""
        task.returned = True
        self._look_at.append(task)

    def kill(self, task: Task, why: str) -> list[Task]:
        """End a task and all below it; those whose handlers run and must be told. What waits for them is released:
        at once, or when the running handlers below have returned.
        """
        running = []
        for doomed in self.tree.subtree(task):
            if doomed.killed:
                continue
            doomed.killed = why
            self._facts.append(Killed(TaskId(doomed.id), why))
            self._bequeath(doomed)
            if doomed.is_running:
                running.append(doomed)
            else:
                doomed.returned = True
                self.withdrawn.append(doomed)
            self._look_at.append(doomed)
        return running

    def _bequeath(self, task: Task) -> None:
        """What waits for a killed task goes on waiting for what that one waited for: the end of a sequence does not
        overtake its beginning because its middle was killed.
        """
        if task.leaders:
            for at, follower, held in list(task.followers or ()):
                if inherited := self._inherit(task, at, follower, held):
                    self._facts.append(Constrained(inherited))

    def _inherit(self, killed: Task, at: int, follower: Task, held: int) -> list[Constraint]:
        """Hold moment *held* of a follower of *killed* at *at* by all that holds *killed* there or before; by what."""
        inherited = []
        for moment, leader_id, its_moment in list(killed.leaders or ()):
            leader = self.tree.tasks.get(leader_id)
            first = START_PLANNING if killed.delayed and moment == START_ACHIEVING else moment
            if leader is None or leader is follower or leader.reached & its_moment or follower.reached & held:
                continue
            if at in comes_after(killed.is_goal, first):
                self._hold(leader, its_moment, follower, held)
                points = Point(TaskId(leader_id), Moment(its_moment)), Point(TaskId(follower.id), Moment(held))
                inherited.append(Constraint(*points))
        return inherited

    def wait(self, task: Task, moment: int, waiter: object) -> None:
        """Put *waiter* into ``met`` when the task reaches that moment."""
        if task.waiters is None:
            task.waiters = []
        task.waiters.append((moment, waiter))

    def stop_waiting(self, task: Task, waiter: object) -> None:
        """Forget a wait that nobody needs any more."""
        task.waiters = [entry for entry in task.waiters or () if entry[1] is not waiter] or None

    def settle(self) -> None:
        """Reach all that can be reached."""
        while self._look_at:
            self._advance(self._look_at.popleft())

    # --- reaching moments ------------------------------------------------------------------------------------------

    def _advance(self, task: Task) -> None:
        """Reach every moment of the task whose time has come; ask for its delivery when that may be."""
        if task.reached == ALL_MOMENTS:
            return
        now = STARTS & ~task.reached if task.killed and not task.is_running else 0
        if not task.killed and not task.requested and self._may_start(task):
            task.requested = True
            self.startable.append(task)
        for moment, needed in MUST_FOLLOW_IN_GOAL if task.is_goal else MUST_FOLLOW_IN_COMMAND:
            reached = task.reached | now
            if not reached & moment and reached & needed == needed and self._may_reach(task, moment):
                now |= moment
        if now:
            self._reach(task, now)

    def _may_start(self, task: Task) -> bool:
        if task.delayed and not self._may_reach(task, START_ACHIEVING):
            return False
        return self._may_reach(task, delivered_at(task.is_goal))

    def _may_reach(self, task: Task, moment: int) -> bool:
        """Whether nothing but the order within the task holds that moment back."""
        if task.held and not task.killed and task.held >> _SHIFT[moment] & _COUNTER:
            return False
        if moment == END_ACHIEVING:
            return not task.children
        if moment == END_PLANNING:
            return not task.unplanned
        if moment == END_HANDLING:
            return task.returned
        if task.killed:
            return not task.is_running
        return bool(task.parent and task.parent.reached & moment)

    def _reach(self, task: Task, moments: int) -> None:
        task.reached |= moments
        self._facts.append(Reached(TaskId(task.id), moments))
        if task.waiters:
            self.met.extend((task, waiter) for moment, waiter in task.waiters if moment & moments)
            task.waiters = [(moment, waiter) for moment, waiter in task.waiters if not moment & moments]
        if task.followers:
            self._release_followers(task, moments)
        if task.children and moments & (START_PLANNING | START_ACHIEVING):
            self._look_at.extend(task.children.values())
        if moments & END_PLANNING and task.is_goal:
            self._child_planned(task)
        if task.reached == ALL_MOMENTS:
            self._end(task)

    def _release_followers(self, task: Task, moments: int) -> None:
        assert task.followers is not None
        for moment, follower, its_moment in task.followers:
            if moment & moments:
                follower.held -= 1 << _SHIFT[its_moment]
                if not follower.held:
                    follower.leaders = None
                self._look_at.append(follower)
        task.followers = [follower for follower in task.followers if not follower[0] & moments] or None

    def _child_planned(self, child: Task) -> None:
        parent = child.parent
        assert parent is not None
        parent.unplanned -= 1
        if not parent.unplanned:
            self._look_at.append(parent)

    def _end(self, task: Task) -> None:
        self.tree.detach(task)
        self.ended.append(task)
        if task.parent is not None and not task.parent.children:
            self._look_at.append(task.parent)

    # --- constraints -----------------------------------------------------------------------------------------------

    def _constrain(self, constraint: Constraint, *, check: bool) -> list[Constraint]:
        """Put one constraint in force; [] if it is met already."""
        before, after = self._place(constraint.before), self._place(constraint.after)
        if before is None or before.task.reached & before.moment:
            return []
        if after is None or after.task.reached & after.moment:
            raise RequestError(Refusal.TOO_LATE, f"constraint {constraint} comes too late: {constraint.after} is past")
        task, moment = after
        if before == (task, START_ACHIEVING) and moment == START_PLANNING:
            return [constraint] if self._delay_planning(task, constraint) else []
        if check:
            self._refuse_cycle(constraint, after, before)
        if task.held >> _SHIFT[moment] & _COUNTER == _COUNTER:
            raise RequestError(Refusal.OVERLOAD, f"{_COUNTER} constraints hold {constraint.after} already")
        self._hold(before.task, before.moment, task, moment)
        inherited = self._inherit(before.task, before.moment, task, moment) if before.task.killed else []
        return [constraint, *inherited]

    @staticmethod
    def _hold(leader: Task, its_moment: int, task: Task, moment: int) -> None:
        """From now on *moment* of *task* waits for *its_moment* of *leader*."""
        if leader.followers is None:
            leader.followers = []
        leader.followers.append((its_moment, task, moment))
        if task.leaders is None:
            task.leaders = []
        task.leaders.append((moment, leader.id, its_moment))
        task.held += 1 << _SHIFT[moment]

    def _delay_planning(self, task: Task, constraint: Constraint) -> bool:
        """Planning starts no earlier than achieving, which starts no earlier than planning: they start together. So
        this is no count on a point; whatever holds back either holds back both. Whether it is so only from now on.
        """
        if task.delayed:
            return False
        if task.children or task.followers:
            text = f"{constraint}: planning can only be delayed when the goal is sent"
            raise RequestError(Refusal.TOO_LATE, text)
        self._refuse_cycle(constraint, Place(task, END_HANDLING), Place(task, START_ACHIEVING))
        task.delayed = True
        return True

    def _refuse_cycle(self, constraint: Constraint, start: Place, goal: Place) -> None:
        """Refuse a constraint from *goal* to *start* if *start* must already come before *goal*."""
        if (path := find_path(self.tree, start, goal)) is not None:
            raise RequestError(Refusal.CYCLE, f"constraint {constraint} can never be met: {_describe_cycle(path)}")

    def _place(self, point: Point) -> Place | None:
        """The live task and moment of a point; None if the task has ended."""
        if int(point.moment) not in SINGLE_MOMENTS:
            raise RequestError(Refusal.PROTOCOL, f"{int(point.moment)} is no moment: one bit of 1 to 32 is")
        task = self.task(point.task)
        return None if task is None else Place(task, unified(task.is_goal, int(point.moment)))

    def task(self, task_id: TaskId) -> Task | None:
        """The live task of that id; None if it has ended. Raises RequestError if there has never been one."""
        task = self.tree.tasks.get(task_id)
        if task is None and not ROOT < task_id <= self.tree.newest:
            raise RequestError(Refusal.UNKNOWN, f"there is no task {task_id}")
        return task

    def _undo(self, added: list[Constraint]) -> None:
        for constraint in reversed(added):
            before, after = self._place(constraint.before), self._place(constraint.after)
            assert before is not None
            assert after is not None
            if before == (after.task, START_ACHIEVING) and after.moment == START_PLANNING:
                after.task.delayed = False
                continue
            assert before.task.followers is not None
            assert after.task.leaders is not None
            before.task.followers.pop()
            after.task.leaders.pop()
            after.task.held -= 1 << _SHIFT[after.moment]

    def _hold_again(self, task: Task) -> None:
        """A new constraint holds a task that was startable but has not been delivered: take it out of the queues."""
        if task.requested and not task.reached & START_HANDLING and not self._may_start(task):
            task.requested = False
            self.withdrawn.append(task)


def held_counts(task: Task) -> dict[int, int]:
    """The number of unmet constraints per moment of a task; for checks and questions."""
    return {moment: count for moment, shift in _SHIFT.items() if (count := task.held >> shift & _COUNTER)}


def _from_flags(flags: Flags, task: Task, last: Task | None) -> list[Constraint]:
    """The constraints that flags stand for. On a command's planning, which is over at birth, they hold nothing."""
    this, value = TaskId(task.id), int(flags)
    constraints = []
    if last is not None:
        if value & _SEQ_ACH:
            constraints.append(sequential_achievement(TaskId(last.id), this))
        if value & _SEQ_PLANNING and task.is_goal:
            constraints.append(sequential_planning(TaskId(last.id), this))
    if value & _DELAY_PLANNING and task.is_goal:
        constraints.append(delay_planning(this))
    if value & _PLAN_FIRST:
        constraints.append(plan_first(this))
    return constraints


def _resolve(constraint: Constraint, this: TaskId) -> Constraint:
    """The constraint with THIS replaced by the new task's id."""
    before, after = constraint.before, constraint.after
    return Constraint(
        Point(this, before.moment) if before.task == THIS else before,
        Point(this, after.moment) if after.task == THIS else after,
    )


def _describe_cycle(path: list[Place]) -> str:
    points = [str(Point(TaskId(place.task.id), Moment(place.moment))) for place in path]
    shown = points if len(points) <= 8 else [*points[:4], f"... {len(points) - 8} more ...", *points[-4:]]
    return f"{' <= '.join([*shown, points[0]])} would be a circle"

"""Holds on moments: constraints are put in force, undone, and passed on by killed tasks.

Theory of operation. A constraint makes one point, the *follower*, wait for another, the *leader*.
Every task counts the unmet constraints on each of its moments (``Task.held``: six counters packed
into one integer). Every task also lists the followers of its own points (``Task.followers``). When
a point is reached, the counters of its followers go down. If the constraint has a delay, a timer is
set first, and the counter goes down when the timer is due. This module knows points, but no
handlers or resources.
"""

from itertools import pairwise
from typing import NamedTuple

from tca_central.errors import RequestError
from tca_central.model.clock import Clock, Timer, checked_seconds
from tca_central.model.intervals import checked_moment, unified
from tca_central.model.stored import Stored
from tca_central.model.task_tree import TaskTree
from tca_central.model.tasks import Scheduled, Task
from tca_central.order.cycles import NON_MONITORS_ENDED, Place, find_path
from tca_wire.constraints import (
    Constraint,
    Flags,
    delay_planning,
    plan_first,
)
from tca_wire.journal.facts import Constrained, Fact, TimedOut
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    ROOT,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    STARTS,
    THIS,
    Moment,
    Point,
    TaskId,
    start_of,
)
from tca_wire.rules import RULES
from tca_wire.vocabulary import Due, Refusal

SEQ_ACH, SEQ_PLANNING = int(Flags.SEQ_ACH), int(Flags.SEQ_PLANNING)
PLAN_FIRST, DELAY_PLANNING = int(Flags.PLAN_FIRST), int(Flags.DELAY_PLANNING)

_SEQUENCES = (
    (SEQ_ACH, END_ACHIEVING, START_ACHIEVING),
    (SEQ_PLANNING, END_PLANNING, START_PLANNING),
)
"""The flags that put a task behind its last sibling: (flag, sibling's moment, task's moment)."""

_MOMENT = {int(moment): moment for moment in Moment}
_BITS = 24
"""The width of one counter of ``held``: up to 16 million constraints on one point.

One integer saves memory: a waiting task takes 1,003 bytes. With a dict of counters it takes 1,183,
at the same speed (dev/benchmarks/core_events.py).
"""
_COUNTER = (1 << _BITS) - 1
_SHIFT = {int(moment): _BITS * i for i, moment in enumerate(Moment)}
_BEGINNINGS = sum(_COUNTER << shift for moment, shift in _SHIFT.items() if moment & STARTS)

VOID_ENTRIES = 32
"""Void entries that a list of leaders or followers may hold beyond the number of valid entries."""

_TIME_ZERO = Point(ROOT, Moment.START_ACHIEVING)
"""The start of the run, at time 0 of central's clock.

The journal records a delay from now on as a delay after this point. For example, a delay of 5 s
that starts at 60 s is recorded as 65 s after this point.
"""


class PendingDelay(Stored):
    """A running delay: *moment* of *task* is held until its timer is due."""

    __slots__ = ("constraint", "moment", "task")

    def __init__(self, task: Task, moment: int, constraint: Constraint) -> None:
        self.task, self.moment, self.constraint = task, moment, constraint


class Holds(Stored):
    """The constraints in force."""

    __slots__ = ("_clock", "_facts", "edge_count", "ended_followers", "ending", "tree")

    def __init__(self, tree: TaskTree, facts: list[Fact], clock: Clock) -> None:
        self.tree = tree
        self._facts = facts
        self._clock = clock
        self.edge_count = 0  #: number of entries in all lists of followers
        self.ended_followers: dict[Task, int] = {}
        """By leader: the number of its followers that ended by a kill while they waited."""
        #: Killed tasks that will end as soon as the agenda advances them.
        self.ending: dict[Task, None] = {}

    # --- put in force -----------------------------------------------------------------------------

    def add(self, constraint: Constraint) -> list[Constraint]:
        """Put one constraint in force. Return the constraints that hold something as a result.

        The list is empty if *constraint* is met already or void. It has more than one constraint if
        the leader was killed. Raises RequestError if *constraint* can never be met, or if its
        follower has been reached.
        """
        if constraint.delay:
            constraint = self._without_void_delay(constraint)
        leader, follower = self.leader(constraint), self.place(constraint.after)
        is_met = leader is None or leader.task.reached & leader.moment
        if is_met and not constraint.delay:
            return []
        if (follower := self._pending_follower(constraint, follower)) is None:
            return []
        task, moment = follower
        if _delays_planning(constraint, leader, follower):
            return [constraint] if self._delay_planning(task, constraint) else []
        if task.held >> _SHIFT[moment] & _COUNTER == _COUNTER:
            raise RequestError(
                Refusal.OVERLOAD, f"{_COUNTER} constraints hold {constraint.after} already"
            )
        if leader is None or is_met:
            return [self._delay(constraint, task, moment)]
        self._refuse_cycles(constraint, follower, leader)
        if constraint.delay:  # with the moments of the graph: ``TimedOut`` names them
            constraint = _constraint(*leader, task, moment, constraint.delay)
        self.hold(*leader, task, moment, constraint.delay)
        inherited = self.inherit(*leader, task, moment) if leader.task.killed else []
        return [constraint, *inherited]

    def follow(self, task: Task, last: Task, flags: int) -> list[Constraint]:
        """Put a new task behind its last sibling as *flags* say. Return the constraints added.

        No search for cycles is needed: nothing can wait for the new task yet.
        """
        added = []
        for flag, leader_moment, moment in _SEQUENCES:
            if flags & flag and not (last.reached & leader_moment or task.reached & moment):
                self.hold(last, leader_moment, task, moment)
                added.append(_constraint(last, leader_moment, task, moment))
                if last.killed:
                    added += self.inherit(last, leader_moment, task, moment)
        return added

    def _delay(self, constraint: Constraint, task: Task, moment: int) -> Constraint:
        """Hold a moment for the delay of a constraint. Return the constraint for the journal."""
        recorded = Constraint(_TIME_ZERO, constraint.after, self._clock.now + constraint.delay)
        task.held += 1 << _SHIFT[moment]
        self._release_later(task, moment, recorded, constraint.delay)
        return recorded

    def pause(self, task: Task, seconds: float) -> Constraint:
        """Hold the next handling of a task for *seconds*. Return the constraint for the journal."""
        wanted = Constraint(_TIME_ZERO, Point(task.id, Moment.START_HANDLING), seconds)
        return self._delay(wanted, task, START_HANDLING)

    def _release_later(self, task: Task, moment: int, constraint: Constraint, delay: float) -> None:
        """Set the timer that releases a moment after *delay* seconds."""
        pending = PendingDelay(task, moment, constraint)
        Scheduled.of(task).pending[pending] = self._clock.after(delay, Due.RELEASE, pending)

    def hold(
        self, leader: Task, leader_moment: int, task: Task, moment: int, delay: float = 0
    ) -> None:
        """Make *moment* of *task* wait for *leader_moment* of *leader*, plus *delay* seconds."""
        if leader.followers is None:
            leader.followers = []
        leader.followers.append((leader_moment, task, moment, delay))
        self.edge_count += 1
        if leader.parent is not task.parent:
            self.tree.crossing_leaders[leader] = None
        if task.leaders is None:
            task.leaders = []
        task.leaders.append((moment, leader.id, leader_moment))
        task.held += 1 << _SHIFT[moment]
        # An entry becomes void when its leader is reached. To remove it then would cost a search of
        # the list. All void entries are removed together when more than half of the list is void.
        # So the cost per entry stays constant.
        if (
            len(task.leaders) > VOID_ENTRIES
            and len(task.leaders) > 2 * sum(held_counts(task).values()) + VOID_ENTRIES
        ):
            task.leaders = [entry for entry in task.leaders if self._is_pending(entry)]

    def _is_pending(self, entry: tuple[int, int, int]) -> bool:
        """Whether the point of an entry of ``leaders`` has not been reached."""
        leader = self.tree.tasks.get(entry[1])
        return leader is not None and not leader.reached & entry[2]

    def _delay_planning(self, task: Task, constraint: Constraint) -> bool:
        """Make planning and achieving start together, so that a hold on either holds both.

        Returns False if the two start together already.
        """
        if task.planning_delayed:
            return False
        if task.children or task.followers:
            text = f"{constraint}: planning can only be delayed when the goal is sent"
            raise RequestError(Refusal.TOO_LATE, text)
        self._refuse_cycle(constraint, Place(task, END_HANDLING), Place(task, START_ACHIEVING))
        task.planning_delayed = True
        return True

    def _refuse_cycles(self, constraint: Constraint, follower: Place, leader: Place) -> None:
        """Raise RequestError if a constraint can never be met.

        If the leader's task was killed, the follower will also wait for that task's own leaders. So
        those waits are checked, too.
        """
        self._refuse_cycle(constraint, follower, leader)
        if leader.task.killed:
            inherited = self._leaders_of(*leader, _KilledTogether(set(), {}))
            for (_, moment), task in inherited.items():
                self._refuse_cycle(constraint, follower, Place(task, moment))

    def _refuse_cycle(self, constraint: Constraint, follower: Place, leader: Place) -> None:
        """Raise RequestError if a constraint's *follower* must already come before its *leader*."""
        if (path := find_path(self.tree, follower, leader)) is not None:
            points = [place for place in (*path, path[0]) if place.moment != NON_MONITORS_ENDED]
            cycle = [str(Point(place.task.id, Moment(place.moment))) for place in points]
            if (more := len(cycle) - 9) > 0:
                cycle[4:-5] = [f"... {more} more ..."]
            text = (
                f"constraint {constraint} can never be met: {' <= '.join(cycle)} would be a cycle"
            )
            advice = _monitor_advice(path) or ": leave out one of these constraints"
            raise RequestError(Refusal.CYCLE, text + advice)

    def undo(self, added: list[Constraint]) -> None:
        """Undo the constraints in *added*, newest first. They were just put in force."""
        for constraint in reversed(added):
            follower = self.place(constraint.after)
            assert follower is not None
            if constraint.before.task == ROOT:
                self._undo_delay(follower.task, constraint)
                continue
            leader = self.place(constraint.before)
            assert leader is not None
            if _delays_planning(constraint, leader, follower):
                follower.task.planning_delayed = False
                continue
            assert leader.task.followers is not None
            assert follower.task.leaders is not None
            leader.task.followers.pop()
            self.edge_count -= 1
            follower.task.leaders.pop()
            follower.task.held -= 1 << _SHIFT[follower.moment]

    def _undo_delay(self, task: Task, constraint: Constraint) -> None:
        """Cancel the timer of a delay that was just started."""
        pending = Scheduled.of(task).pending
        for release in [
            one for one in pending if isinstance(one, PendingDelay) and one.constraint is constraint
        ]:
            timer = pending.pop(release)
            assert isinstance(timer, Timer)
            self._clock.cancel(timer)
            task.held -= 1 << _SHIFT[release.moment]

    # --- release ----------------------------------------------------------------------------------

    def release_followers(self, task: Task, moments: int) -> list[Task]:
        """Release the followers of *moments* of *task*: these moments have just been reached.

        Returns the tasks of the released followers. If the constraint has a delay, the follower is
        not released yet: a timer holds it.
        """
        assert task.followers is not None
        freed = []
        for moment, follower, follower_moment, delay in task.followers:
            if not moment & moments or (
                delay and self._start_delay(task, moment, follower, follower_moment, delay)
            ):
                continue
            follower.held -= 1 << _SHIFT[follower_moment]
            if not follower.held:
                follower.leaders = None
            freed.append(follower)
        self._set_followers(
            task, [follower for follower in task.followers if not follower[0] & moments]
        )
        return freed

    def _set_followers(self, leader: Task, left: list[tuple[int, Task, int, float]]) -> None:
        """Replace a task's list of followers by *left*, the entries that remain."""
        self.edge_count -= len(leader.followers or ()) - len(left)
        leader.followers = left or None
        if not left and self.ended_followers:
            self.ended_followers.pop(leader, None)

    def _start_delay(
        self, task: Task, moment: int, follower: Task, follower_moment: int, delay: float
    ) -> bool:
        """Start the delay of a follower: its leader's moment has just been reached.

        Returns False if the follower must be released now, because the delay is void: the leader's
        interval never began. A follower that has ended is not released.
        """
        if follower.reached == ALL_MOMENTS:
            return True
        constraint = _constraint(task, moment, follower, follower_moment, delay)
        if not self._never_comes(constraint.before):
            self._release_later(follower, follower_moment, constraint, delay)
            return True
        if not follower.killed:
            self._facts.append(TimedOut(constraint))
        return False

    @staticmethod
    def end_delay(delay: PendingDelay) -> None:
        """Release the moment of a delay that is over."""
        del Scheduled.of(delay.task).pending[delay]
        delay.task.held -= 1 << _SHIFT[delay.moment]
        if not delay.task.held:
            delay.task.leaders = None

    def forget(self, task: Task) -> None:
        """Forget the leaders of a killed task that has ended.

        The leaders still list the task among their followers. A leader removes such void entries
        when they are about half of its list.
        """
        for entry in task.leaders or ():
            leader = self.tree.tasks.get(entry[1])
            if leader is None or leader.reached & entry[2] or not leader.followers:
                continue
            ended = self.ended_followers.get(leader, 0) + 1
            self.ended_followers[leader] = ended
            if ended > len(leader.followers) // 2 + VOID_ENTRIES:
                self._set_followers(
                    leader, [one for one in leader.followers if one[1].reached != ALL_MOMENTS]
                )
                self.ended_followers.pop(leader, None)
        task.leaders = None

    # --- killed tasks -----------------------------------------------------------------------------

    def pass_on(self, killed: list[Task]) -> None:
        """Make the followers of killed tasks wait for the leaders of those tasks.

        This preserves the order of a sequence. If B in the sequence A, B, C is killed, C then waits
        for A.
        """
        self.ending.update(_ending(killed))
        group = _KilledTogether(set(killed), {})
        for task in killed:
            if task.leaders:
                for moment, follower, follower_moment, _ in list(task.followers or ()):
                    if follower not in self.ending and (
                        added := self.inherit(task, moment, follower, follower_moment, group)
                    ):
                        self._facts.append(Constrained(added))

    def inherit(
        self,
        killed: Task,
        moment: int,
        follower: Task,
        follower_moment: int,
        group: "_KilledTogether | None" = None,
    ) -> list[Constraint]:
        """Make a moment of *follower* wait for everything that *moment* of *killed* waits for.

        Returns the new constraints.
        """
        if follower.reached & follower_moment:
            return []
        holding = self._leaders_of(killed, moment, group or _KilledTogether(set(), {}))
        for (_, leader_moment), leader in holding.items():
            self.hold(leader, leader_moment, follower, follower_moment)
        return [
            _constraint(leader, leader_moment, follower, follower_moment)
            for (_, leader_moment), leader in holding.items()
        ]

    def _leaders_of(
        self, killed: Task, moment_of_killed: int, group: "_KilledTogether"
    ) -> "dict[tuple[int, int], Task]":
        """Return the leaders of *moment_of_killed* of a killed task, by (task id, moment).

        If the same kill has killed a leader, the result also has that leader's own leaders.
        Killed tasks that end at once are left out.
        """
        origin, known = (int(killed.id), moment_of_killed), group.known
        if origin in known:
            return known[origin]
        found: dict[tuple[int, int], Task] = {}
        frontier, seen = [(killed, moment_of_killed)], {origin}
        for task, moment in frontier:  # grows while it is walked
            up_to = RULES[task.message.is_goal].up_to[moment]
            for own_moment, leader_id, leader_moment in task.leaders or ():
                leader, place = self.tree.tasks.get(leader_id), (leader_id, leader_moment)
                if task.planning_delayed and own_moment == START_ACHIEVING:
                    own_moment = START_PLANNING  # noqa: PLW2901 - the two are reached together
                if leader is None or leader.reached & leader_moment or not up_to & own_moment:
                    continue
                if leader not in self.ending:
                    found[place] = leader
                if place in known:
                    found.update(known[place])
                elif leader in group.killed and place not in seen:
                    seen.add(place)
                    frontier.append((leader, leader_moment))
        known[origin] = found
        return found

    # --- points -----------------------------------------------------------------------------------

    def leader(self, constraint: Constraint) -> Place | None:
        """Return the point that a constraint waits for; None if the point's task has ended.

        Also None for a start of the root, which is always past. Raises RequestError for an end of
        the root, which never comes.
        """
        if constraint.before.task != ROOT:
            return self.place(constraint.before)
        if constraint.before.moment & STARTS:
            return None
        raise RequestError(
            Refusal.CYCLE, "a constraint waits for the end of the root, which never ends"
        )

    def _without_void_delay(self, constraint: Constraint) -> Constraint:
        """Return the constraint, or a copy without the delay if the delay can never begin."""
        checked_seconds(constraint.delay, f"constraint {constraint} with a delay")
        return (
            Constraint(constraint.before, constraint.after)
            if self._never_comes(constraint.before)
            else constraint
        )

    def _pending_follower(self, constraint: Constraint, follower: Place | None) -> Place | None:
        """Return the point that a constraint holds back.

        None if the point never comes, because its task was killed before. Raises RequestError if
        the point is past.
        """
        if self._never_comes(constraint.after):
            return None
        if follower is None or follower.task.reached & follower.moment:
            raise RequestError(
                Refusal.TOO_LATE,
                f"constraint {constraint} comes too late: {constraint.after} is past",
            )
        return follower

    def _never_comes(self, point: Point) -> bool:
        """Whether a point never comes: its task was killed before the point's interval began."""
        unbegun = self.tree.never_began.get(point.task)
        return unbegun is not None and bool(unbegun & start_of(int(point.moment)))

    def place(self, point: Point) -> Place | None:
        """Return the live task and moment of a point; None if the task has ended."""
        moment, task = checked_moment(point), self.tree.task(point.task)
        return None if task is None else Place(task, unified(task.is_goal, moment))


def _delays_planning(constraint: Constraint, leader: Place | None, follower: Place) -> bool:
    """Whether a constraint is DELAY_PLANNING: a goal's own planning waits for its achieving.

    Such a constraint becomes a flag of the task. Stored as an ordinary constraint it would hold the
    goal for ever: achieving cannot start before handling, and handling starts with planning.
    """
    return (
        not constraint.delay
        and leader == (follower.task, START_ACHIEVING)
        and follower.moment == START_PLANNING
    )


class _KilledTogether(NamedTuple):
    """Tasks killed by one kill. *known* caches these tasks' leaders, by task id and moment."""

    killed: set[Task]
    known: dict[tuple[int, int], dict[tuple[int, int], Task]]


def _ending(killed: list[Task]) -> dict[Task, None]:
    """Return those of the *killed* tasks that end at once.

    A task lasts longer if a handler has it, if it is a monitor, or if it has termination messages
    to send. It also lasts longer if one of its children does.
    """
    staying: set[Task] = set()
    doomed = set(killed)
    for task in reversed(killed):  # children come before their parents
        must_finish = (
            task.is_running
            or task.watch is not None
            or (task.scheduled is not None and task.scheduled.termination_messages)
        )
        if must_finish or any(
            child not in doomed or child in staying for child in (task.children or {}).values()
        ):
            staying.add(task)
    return {task: None for task in killed if task not in staying}


def _monitor_advice(path: list[Place]) -> str:
    """Return advice for a cycle that passes through a background monitor; "" for others."""
    for place, monitor in reversed(list(pairwise(path))):
        if place.moment == NON_MONITORS_ENDED:
            until = f"until all else under {place.task} has ended"
            advice = "If it will end earlier, send it waited_for=True"
            return f": {monitor.task} may watch {until}. {advice}"
    return ""


def _constraint(
    leader: Task, leader_moment: int, follower: Task, moment: int, delay: float = 0
) -> Constraint:
    """Return a constraint between live tasks in the form that modules and the journal know."""
    return Constraint(
        Point(leader.id, _MOMENT[leader_moment]), Point(follower.id, _MOMENT[moment]), delay
    )


def is_held(task: Task, moment: int) -> bool:
    """Whether a constraint holds back *moment* of a task."""
    return bool(task.held >> _SHIFT[moment] & _COUNTER)


def has_held_start(task: Task) -> bool:
    """Whether a constraint holds back a start of the task."""
    return bool(task.held & _BEGINNINGS)


def held_counts(task: Task) -> dict[int, int]:
    """Return the number of unmet constraints per moment, for checks and ``tca status``."""
    return {
        moment: count
        for moment, shift in _SHIFT.items()
        if (count := task.held >> shift & _COUNTER)
    }


def from_flags(flags: int, task: Task) -> list[Constraint]:
    """Return the constraints between a new task's own moments that *flags* stand for."""
    constraints = []
    if flags & DELAY_PLANNING and task.is_goal:
        constraints.append(delay_planning(task.id))
    if flags & PLAN_FIRST:
        constraints.append(plan_first(task.id))
    return constraints


def resolve(constraint: Constraint, this: TaskId) -> Constraint:
    """Return the constraint with THIS replaced by the new task's id."""
    before, after = constraint.before, constraint.after
    return Constraint(
        Point(this, before.moment) if before.task == THIS else before,
        Point(this, after.moment) if after.task == THIS else after,
        constraint.delay,
    )

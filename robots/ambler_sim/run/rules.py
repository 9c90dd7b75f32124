"""Rules that every walk must keep: ``tca check walk/journal robots/ambler_sim/run/rules.py``.

At its end, a walk checks itself against these rules. This file imports nothing of the robot, so
that a journal can be checked without the robot.
"""

from bisect import bisect_left
from collections.abc import Iterator
from operator import attrgetter

from tca_tools.journal.records import Claim, Handling, Message, Task, TaskState
from tca_tools.journal.whole_run import Run
from tca_tools.properties import in_all_cases, in_at_least, property_from
from tca_wire.points import Moment

MOVE_LEG, MOVE_BODY, TAKE_STEPS, RANGES = "move leg", "move body", "take steps", "ranges"
MOVES = (MOVE_LEG, MOVE_BODY)
SCANNER, CONTROLLER = "scanner", "controller"


def stability_check_precedes_each_try_of_a_move(run: Run) -> Iterator[tuple[Task, bool]]:
    """Whenever a leg or body move begins, a stability check has succeeded since its last try."""
    for move in _named(run, *MOVES):
        last_try_ended = 0.0
        for handling in move.handlings:
            yield move, _is_checked(run, move, "stability check", last_try_ended, handling.start)
            last_try_ended = handling.until


def footfall_check_follows_each_leg_move(run: Run) -> Iterator[tuple[Task, bool]]:
    """Before a leg move is achieved, a footfall check has succeeded since its last handling."""
    for move in _named(run, MOVE_LEG):
        if move.state is TaskState.ACHIEVED:
            moved = move.handlings[-1].until if move.handlings else 0.0
            achieved = move.time_of(Moment.END_ACHIEVING)
            yield move, _is_checked(run, move, "footfall check", moved, achieved)


def step_is_planned_while_the_one_before_is_walked(run: Run) -> Iterator[tuple[Task, bool]]:
    """Each step but the first of an arc is planned while the step before it is walked.

    Its planner ran after the step before could begin and before the end of that step's moves. A
    step that was planned again counts again.
    """
    for step in _named(run, TAKE_STEPS):
        earlier = run.tasks.get(step.parent)
        if earlier is not None and earlier.name == TAKE_STEPS:
            begin = earlier.time_of(Moment.START_ACHIEVING)
            end = _end_of_moves(run, earlier, step.by)
            walked = [child for child in _children(run, step, MOVE_BODY) if child.handlings]
            for planning in (body_move.by for body_move in walked):
                if planning is not None:  # None: error recovery has ordered the move
                    yield step, planning.start < end and planning.until > begin


def no_move_while_the_scanner_holds_the_controller(
    run: Run,
) -> Iterator[tuple[Message | Claim, bool]]:
    """While the scanner has locked the controller, no move is handled."""
    moves = sorted((move for move in run.handlings if move.name in MOVES), key=attrgetter("start"))
    for lock in run.granted(CONTROLLER, CONTROLLER):
        if lock.sender == SCANNER and lock.granted is not None:
            last = bisect_left(moves, lock.until, key=attrgetter("start")) - 1
            yield _holder(run, lock), last < 0 or moves[last].until <= lock.granted


def image_is_taken_while_the_scanner_holds_the_controller(
    run: Run,
) -> Iterator[tuple[Message, bool]]:
    """Whenever the range finder is read, the scanner has locked the controller."""
    locks = [lock for lock in run.granted(CONTROLLER, CONTROLLER) if lock.sender == SCANNER]
    for message in run.messages.values():
        for reading in message.handlings if message.name == RANGES else ():
            last = bisect_left(locks, reading.start, key=attrgetter("granted")) - 1
            yield message, last >= 0 and reading.until <= locks[last].until


STABILITY = in_all_cases(stability_check_precedes_each_try_of_a_move)
FOOTFALL = in_all_cases(footfall_check_follows_each_leg_move)
PLANNED_AHEAD = in_at_least(0.9, step_is_planned_while_the_one_before_is_walked, fewest=20)
NO_MOVE_WHILE_LOCKED = in_all_cases(no_move_while_the_scanner_holds_the_controller)
IMAGE_LOCKED = in_all_cases(image_is_taken_while_the_scanner_holds_the_controller)

RULES = [
    STABILITY,
    FOOTFALL,
    PLANNED_AHEAD,
    property_from("at most 1 planned ahead of take steps"),
    NO_MOVE_WHILE_LOCKED,
    IMAGE_LOCKED,
    property_from("at most 1 handled of move leg"),
    property_from("at most 1 handled of move body"),
    property_from("at most 1 handled of acquire image"),
    property_from("move leg begun before move body achieved"),
]


def _named(run: Run, *names: str) -> Iterator[Task]:
    return (task for task in run.tasks.values() if task.name in names)


def _children(run: Run, task: Task, *names: str) -> Iterator[Task]:
    return (child for child in map(run.tasks.__getitem__, task.children) if child.name in names)


def _is_checked(run: Run, move: Task, name: str, since: float, until: float) -> bool:
    """Return whether a check of a move has begun and succeeded between these times."""
    return any(
        since <= check.time_of(Moment.START_HANDLING)
        and check.time_of(Moment.END_ACHIEVING) <= until
        for check in _children(run, move, name)
        if check.state is TaskState.ACHIEVED
    )


def _end_of_moves(run: Run, step: Task, planner: Handling | None) -> float:
    """Return the end of the moves of a step that *planner*, a run of the planner, has ordered."""
    moves = (move for move in _children(run, step, *MOVES) if move.by is planner)
    return max((handling.until for move in moves for handling in move.handlings), default=0.0)


def _holder(run: Run, lock: Claim) -> Message | Claim:
    return run.messages[lock.by.message_id] if lock.by is not None else lock

"""The rules of walks, each on a made run that keeps it and on one that breaks it."""

import re
from pathlib import Path

import pytest
from tools.story import QUERY, Story

from robots.ambler_sim.run.rules import (
    FOOTFALL,
    IMAGE_LOCKED,
    NO_MOVE_WHILE_LOCKED,
    PLANNED_AHEAD,
    RULES,
    STABILITY,
)
from tca_tools.check.checked_run import CheckedRun
from tca_tools.check.rules import GRANTED, LOCKED
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Role

FILE = Path(__file__).parents[2] / "robots/ambler_sim/run/rules.py"
PLANNED = Moment.END_PLANNING


def begun() -> Story:
    """Return a story in which the modules have joined."""
    story = (
        Story()
        .module("gait planner", "traverse arc", "take steps")
        .module("scanner", "acquire image")
    )
    story.module("layer", "stability check", "footfall check")
    story.module("controller", "move leg", "move body")
    story.say(facts.ResourceChanged("controller", "range finder", 1))
    return story.say(facts.HandlerAdded("ranges", "controller", "range finder")).at(1.0)


def check(story: Story, name: str, move: int, took: float = 0.1) -> None:
    """Add a wiretap's check of a move."""
    number = story.command(name, "central", move, origin=0, role=Role.LISTENER, about=move)
    story.acted(number, "layer", took)


def test_walk_rules_do_not_import_the_robot() -> None:
    assert not re.search(r"^\s*(from|import) robots", FILE.read_text(), re.MULTILINE)


# --- checks before and after moves ----------------------------------------------------------------


def tried_twice(checks: tuple[int, int]) -> History:
    """Return a run in which a leg move fails and is retried. *checks* has the numbers of stability
    checks before each attempt.
    """
    story = begun()
    move = story.command("move leg", "gait planner")
    for tried, number in enumerate(checks):
        for _ in range(number):
            check(story, "stability check", move)
        now = story.entries[-1].time
        story.at(now + 0.1).delivered(move, "controller").at(now + 1.1)
        if tried:
            story.achieved(move)
        else:
            story.failed(move, "terrain collision").say(
                facts.Retried(TaskId(move), b"", "error recovery")
            )
    return story.fold()


@pytest.mark.parametrize(
    ("checks", "kept"), [((1, 1), 2), ((1, 0), 1), ((2, 0), 1), ((0, 1), 1), ((0, 0), 0)]
)
def test_each_attempt_of_a_move_needs_its_own_check(checks: tuple[int, int], kept: int) -> None:
    counted = STABILITY.count(tried_twice(checks))
    assert (counted.good, counted.number) == (kept, 2)
    assert STABILITY.allows(counted) is (kept == 2)


def test_stability_check_ending_after_the_move_began_is_late() -> None:
    story = begun()
    move = story.command("move body", "gait planner")
    late = story.command(
        "stability check", "central", move, origin=0, role=Role.LISTENER, about=move
    )
    story.delivered(late, "layer").delivered(move, "controller").at(2.0).achieved(late).at(
        3.0
    ).achieved(move)
    assert [task.id for task in STABILITY.count(story.fold()).bad] == [move]


def moved(*, checked: bool, achieved_first: bool = False) -> History:
    story = begun()
    move = story.command("move leg", "gait planner")
    story.delivered(move, "controller").at(2.0).returned(move)
    if achieved_first:
        story.reached(move, Moment.END_ACHIEVING).at(2.5)
    if checked:
        check(story, "footfall check", move)
    return story.reached(move, Moment.END_ACHIEVING).fold()


def test_footfall_check_follows_each_leg_move() -> None:
    assert str(FOOTFALL.count(moved(checked=True))) == "1 of 1"
    assert str(FOOTFALL.count(moved(checked=False))) == "0 of 1"
    assert str(FOOTFALL.count(moved(checked=True, achieved_first=True))) == "0 of 1"


def test_killed_leg_move_needs_no_footfall_check() -> None:
    story = begun()
    move = story.command("move leg", "gait planner")
    story.delivered(move, "controller").at(2.0).returned(move).say(
        facts.Killed(TaskId(move), "planned again")
    )
    assert FOOTFALL.count(story.reached(move, Moment.END_ACHIEVING).fold()).number == 0


# --- planning ahead -------------------------------------------------------------------------------


def walked(*ahead: bool) -> History:
    """Return a run of an arc with one more step than flags. Each flag says whether the next step is
    planned during the present step or after it.
    """
    story = begun()
    arc = story.goal("traverse arc", "user", to="gait planner", begins=True)
    step = story.goal("take steps", "gait planner", arc)
    story.returned(arc).reached(arc, PLANNED).delivered(step, "gait planner")
    for is_ahead in (*ahead, False):
        leg, body = (
            story.command("move leg", "gait planner", step),
            story.command("move body", "gait planner", step),
        )
        rest = story.goal("take steps", "gait planner", step)
        now = story.entries[-1].time
        story.at(now + 0.5).returned(step).reached(step, PLANNED, Moment.START_ACHIEVING).acted(
            leg, "controller", 1.0
        )
        story.delivered(body, "controller")
        if is_ahead:
            story.delivered(rest, "gait planner").at(now + 2.5).achieved(body)
        else:
            story.at(now + 2.5).achieved(body).at(now + 2.6).delivered(rest, "gait planner")
        step = rest
    return story.fold()


def test_planned_ahead_counts_steps_planned_during_a_walk() -> None:
    assert str(PLANNED_AHEAD.count(walked(True, True))) == "2 of 2"
    sequential = PLANNED_AHEAD.count(walked(False, False))
    assert str(sequential) == "0 of 2"
    assert PLANNED_AHEAD.count(walked()).number == 0  # the first step of an arc has no predecessor


def test_planned_ahead_allows_nine_steps_of_ten() -> None:
    nine, eight = (
        PLANNED_AHEAD.count(walked(*[True] * number, *[False] * (20 - number)))
        for number in (18, 17)
    )
    assert (str(nine), PLANNED_AHEAD.allows(nine)) == ("18 of 20", True)
    assert (str(eight), PLANNED_AHEAD.allows(eight)) == ("17 of 20", False)


def test_replanned_step_is_not_planned_ahead() -> None:
    """The step during which it was first planned was walked long before."""
    story = begun()
    arc = story.goal("traverse arc", "user", to="gait planner", begins=True)
    step = story.goal("take steps", "gait planner", arc)
    story.delivered(step, "gait planner")
    body = story.command("move body", "gait planner", step)
    rest = story.goal("take steps", "gait planner", step)
    story.at(1.5).returned(step).reached(step, PLANNED, Moment.START_ACHIEVING).delivered(
        rest, "gait planner"
    )
    story.acted(body, "controller", 1.0)
    for now, is_last in ((3.0, False), (5.0, True)):
        if is_last:
            story.delivered(rest, "gait planner")
        body = story.command("move body", "gait planner", rest)
        story.at(now).returned(rest)
        if not is_last:
            story.acted(body, "controller", 0.5).say(
                facts.Retried(TaskId(rest), b"", "error recovery")
            ).at(4.0)
    story.acted(body, "controller", 1.0)
    assert str(PLANNED_AHEAD.count(story.fold())) == "1 of 2"


# --- the scanner's lock ---------------------------------------------------------------------------


def imaged(how: str) -> Story:
    """Return a story of a leg move beside an image. The image's lock waits for the move, is granted
    too early, or is missing.
    """
    story = begun()
    move = story.command("move leg", "gait planner", to="controller")
    look = story.command("acquire image", "gait planner", to="scanner")
    if how != "no lock":
        story.at(1.5).say(facts.Claimed(90, "controller", "controller", False, "scanner", look))
    if how in ("kept", "entered"):
        story.at(2.0).achieved(move)
    if how != "no lock":
        story.say(facts.Granted(90))
    if how == "entered":
        move = story.at(2.1).command("move body", "gait planner", to="controller")
    story.at(2.2)
    scan = story.received("ranges", QUERY, "scanner", origin=look, blocking=True)
    story.say(facts.Delivered(scan, scan, "controller", "range finder")).at(2.5)
    story.returned(scan).say(facts.Answered(scan))
    if how != "no lock":
        story.say(facts.ClaimEnded(90, "released"))
    story.at(2.6).achieved(look)
    return story if how == "kept" else story.at(3.0).achieved(move)


def violated(story: Story, folder: Path) -> set[str]:
    journal = open_log(story.say(facts.Closed("interrupted")).write(folder))
    checked = CheckedRun.of(journal, RULES, History())
    return {violation.rule for violation in checked.violations}


def test_move_during_the_scanner_lock_breaks_the_rule(tmp_path: Path) -> None:
    """The general rules of locks report the move, too."""
    own = str(NO_MOVE_WHILE_LOCKED)
    assert not {own, LOCKED.text, GRANTED.text} & violated(imaged("kept"), tmp_path / "kept")
    assert {own, LOCKED.text} <= violated(imaged("entered"), tmp_path / "entered")
    assert {own, GRANTED.text} <= violated(imaged("granted too early"), tmp_path / "early")


def test_image_without_a_lock_breaks_only_the_image_rule() -> None:
    """Rules of locks do not apply without a lock."""
    assert str(IMAGE_LOCKED.count(imaged("kept").fold())) == "1 of 1"
    assert str(IMAGE_LOCKED.count(imaged("no lock").fold())) == "0 of 1"
    assert NO_MOVE_WHILE_LOCKED.count(imaged("no lock").fold()).number == 0

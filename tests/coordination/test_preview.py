"""A robot brings an object to box B, or to C if B is occupied: what it foresees, and what it does
ahead.
"""

from collections.abc import Sequence
from typing import Any

import pytest
from coordination.drawn_machines import Drawn

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Candidate,
    Continuous,
    Coordination,
    Discrete,
    Do,
    Fact,
    LikelyArrow,
    Perceived,
    Policy,
    PreviewLimits,
    Prior,
    Situation,
    expected_gain,
    most_likely,
    progress_only,
)
from tca_behaviours.coordination.preview.branches import needed_later
from tca_behaviours.coordination.preview.decide import (
    Decision,
    EarlyWork,
    LookAhead,
    Present,
    WorkPhase,
)
from tca_module import Command, MisuseError, Variable
from tca_wire.coordination import Foreseen, Objection, Reason

MOVE_BASE = Command("move base", str, progress=float)
MOVE_ARM = Command("move arm", str, progress=float)
MOVE_GRIPPER = Command("move gripper", str)
BOX_B_FREE = Variable("box B is free", float)
BASE, ARM, GRIPPER = Agent("base"), Agent("arm"), Agent("gripper")
START: dict[str, Fact] = {"base": "A", "arm": "home", "holding": True}


def base(place: str) -> Activity:
    return Activity(Do(MOVE_BASE, place, BASE), makes={"base": place}, cost=1.0)


def arm(pose: str, *, can_undo: bool = False) -> Activity:
    undo = Do(MOVE_ARM, "home", ARM) if can_undo else ()
    return Activity(Do(MOVE_ARM, pose, ARM), makes={"arm": pose}, cost=0.2, undo=undo)


def drop(place: str) -> Activity:
    return Activity(
        Do(MOVE_GRIPPER, "open", GRIPPER),
        needs={"arm": place, "base": place},
        makes={"holding": False},
        cost=5.0,
    )


with Coordination("deliver", facts=START) as DELIVER:
    waiting = DELIVER.state("waiting")
    to_b = DELIVER.state("going to B", base("B"))
    with DELIVER.compound("at B") as at_b:
        arm_b = DELIVER.state("arm to B", arm("B"))
        drop_b = DELIVER.state("dropping at B", drop("B"))
        drop_b_done = DELIVER.final("dropped at B")
        arm_b.to(drop_b)
        drop_b.to(drop_b_done)
    to_c = DELIVER.state("going to C", base("C"))
    arm_c = DELIVER.state("arm to C", arm("C"))
    drop_c = DELIVER.state("dropping at C", drop("C"))
    tuck = DELIVER.state("tucking", arm("tucked"))
    to_a = DELIVER.state("going to A", base("A"))
    home = DELIVER.state("homing", arm("home"))
    waiting.to(to_b, on="object given")
    to_b.to(at_b, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
    to_b.to(to_c, likelihood=Perceived(BOX_B_FREE, negated=True))
    at_b.to(tuck)
    to_c.to(arm_c)
    arm_c.to(drop_c)
    drop_c.to(tuck)
    tuck.to(to_a)
    to_a.to(home)
    home.to(waiting)

LABELS = [state.label for state in DELIVER.states]


def number(label: str) -> int:
    return LABELS.index(label)


def situation(free: float | None = 1.0, progress: float = 0.0) -> Situation:
    return Situation("", START, {BOX_B_FREE.name: free}, progress)


def foreseen(
    current: str, free: float | None = 1.0, limits: PreviewLimits | None = None
) -> list[str]:
    found = most_likely(
        DELIVER.automaton(situation(free)), number(current), limits or PreviewLimits()
    )
    return [LABELS[one.state] for one in found]


def decided(
    current: str,
    facts: dict[str, Fact] | None = None,
    work: Sequence[EarlyWork] = (),
    *,
    machine: Coordination = DELIVER,
    free: float = 1.0,
    progress: float = 0.6,
    is_done: bool = False,
    is_new: bool = False,
    spoilt: Sequence[str] = (),
    policy: Policy | None = None,
) -> Decision:
    automaton = machine.automaton(situation(free, progress))
    present = Present(
        [state.label for state in machine.states].index(current),
        START if facts is None else facts,
        situation(free, progress),
        is_done=is_done,
        is_new=is_new,
        work=work,
        spoilt=spoilt,
    )
    look_ahead = LookAhead(
        policy or Discrete(0.5, progress_only), PreviewLimits(), needed_later(machine)
    )
    return look_ahead.decide(automaton, present)


def ahead(label: str, phase: WorkPhase = WorkPhase.RUNNING, progress: float = 0.0) -> EarlyWork:
    return EarlyWork(number(label), phase, progress)


# --- what is foreseen -----------------------------------------------------------------------------


def test_preview_ends_at_a_waiting_state() -> None:
    way_back = ["tucking", "going to A", "homing", "waiting"]
    assert foreseen("going to B") == ["arm to B", "dropping at B", "dropped at B", *way_back]
    assert foreseen("going to B", free=0.3) == [
        "going to C",
        "arm to C",
        "dropping at C",
        *way_back,
    ]
    assert foreseen("going to B", free=None) == [], "nobody knows"
    assert foreseen("waiting") == [], "an event of others is not foreseen"


def test_preview_probabilities_multiply_along_the_path() -> None:
    first, second, *_ = most_likely(DELIVER.automaton(situation(0.75)), number("going to B"))
    assert first == Foreseen(number("arm to B"), 0.75, 0.75)
    assert second == Foreseen(number("dropping at B"), 1.0, 0.75)


def test_preview_ends_at_its_horizon() -> None:
    assert foreseen("going to B", limits=PreviewLimits(horizon=2)) == ["arm to B", "dropping at B"]


def test_preview_prefers_the_shorter_then_the_first_path() -> None:
    def arrows(*targets: int) -> list[LikelyArrow]:
        return [LikelyArrow("done", target, 1 / len(targets)) for target in targets]

    ends: dict[int, list[LikelyArrow]] = {8: [], 9: []}
    assert most_likely(Drawn({0: arrows(1, 9), 1: arrows(8), **ends}), 0) == [Foreseen(9, 0.5, 0.5)]
    seen_late = Drawn(
        {
            0: [LikelyArrow("done", 1, 0.5), LikelyArrow("done", 3, 0.25)],
            1: arrows(2),
            2: [LikelyArrow("done", 8, 0.5), LikelyArrow("done", 0, 0.5)],
            3: arrows(9),
            **ends,
        }
    )
    assert [one.state for one in most_likely(seen_late, 0)] == [3, 9], "0.25, as that by 1 and 2"
    two_long = Drawn({0: arrows(1, 2), 1: arrows(8), 2: arrows(9), **ends})
    assert [one.state for one in most_likely(two_long, 0)] == [1, 8]
    unlike = Drawn(
        {
            0: [LikelyArrow("done", 1, 0.25), LikelyArrow("done", 2, 0.75)],
            1: arrows(8),
            2: arrows(3, 4, 9),
            **ends,
        }
    )
    unlike.arrows |= {3: arrows(0), 4: arrows(0)}
    assert [one.state for one in most_likely(unlike, 0)] == [1, 8], (
        "both have 0.25; its first arrow is written first"
    )


def test_most_likely_path_is_found_below_float_range() -> None:
    """Its probability is less than the least float."""
    length = 2000
    arrows = {state: [LikelyArrow("done", state + 1, 0.55)] for state in range(length)}
    for state in range(length - 1):
        arrows[state].append(LikelyArrow("short cut", state + 2, 0.45))
    found = most_likely(Drawn({**arrows, length: []}), 0)
    assert [one.state for one in found] == list(range(2, length + 1, 2))
    assert found[-1].probability == 0


def test_preview_ends_where_limits_make_a_state_steady() -> None:
    with Coordination("doubt") as doubt:
        first, second, third = (doubt.state(label, arm(label)) for label in ("one", "two", "three"))
        first.to(second, likelihood=Prior(0.7))
        second.to(third, likelihood=Prior(0.4))
        third.to(first)
    automaton = doubt.automaton(Situation())
    lengths = [len(most_likely(automaton, 0, PreviewLimits(final))) for final in (0.3, 0.6, 0.7)]
    assert lengths == [0, 1, 2]
    assert len(most_likely(automaton, 0, PreviewLimits(0.9, transition=0.4))) == 1


def test_preview_of_an_endless_machine_covers_one_cycle() -> None:
    with Coordination("round") as machine:
        labels = ("one", "two", "three")
        states = [machine.state(label, arm(label)) for label in labels]
        for state, following in zip(states, [*states[1:], states[0]], strict=True):
            state.to(following)
    automaton = machine.automaton(Situation())
    assert [one.state for one in most_likely(automaton, 1)] == [2, 0]
    assert [one.state for one in most_likely(automaton, 1, PreviewLimits(horizon=4))] == [
        2,
        0,
        1,
        2,
    ]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"final": 0.0}, "final must be above 0, and 1 at most, not 0.0"),
        ({"transition": 1.0}, "transition must be 0 or more, and less than 1, not 1.0"),
        ({"horizon": 0}, "horizon must be 1 or more, or None for any number, not 0"),
    ],
)
def test_invalid_preview_limits_are_rejected(wrong: dict[str, float], told: str) -> None:
    with pytest.raises(MisuseError, match=told):
        PreviewLimits(**wrong)  # type: ignore[arg-type]


# --- what starts, and what does not ---------------------------------------------------------------


def test_likely_next_activity_starts_early() -> None:
    decision = decided("going to B")
    assert decision.shares == {number("arm to B"): 1.0}
    assert decision.refused == [
        Objection(number("dropping at B"), Reason.NEEDS, "arm"),
        Objection(number("tucking"), Reason.CONFLICT, "arm", number("arm to B")),
        Objection(number("going to A"), Reason.CONFLICT, "base", number("going to B")),
        Objection(number("homing"), Reason.CONFLICT, "arm", number("arm to B")),
    ]


def test_low_utility_prevents_an_early_start() -> None:
    early = decided("going to B", progress=0.4)
    assert early.shares == {}
    assert early.refused[0] == Objection(
        number("arm to B"), Reason.UTILITY, other=number("going to B")
    )


def test_early_result_meets_the_needs_of_the_next_state() -> None:
    facts: dict[str, Fact] = {"base": "B", "arm": "B", "holding": True}
    decision = decided("going to B", facts, [ahead("arm to B", WorkPhase.DONE)], is_done=True)
    assert (decision.shares, decision.stops) == ({number("dropping at B"): 1.0}, [])


def test_wrong_prediction_stops_work_before_a_new_start() -> None:
    without_arm: dict[str, Fact] = {"base": "A", "holding": True}
    occupied = decided("going to C", without_arm, [ahead("arm to B")])
    assert occupied.stops == [Objection(number("arm to B"), Reason.NOT_FORESEEN)]
    assert occupied.shares == {}, "the arm has not stopped yet"
    assert occupied.refused[0] == Objection(
        number("arm to C"), Reason.CONFLICT, "arm", number("arm to B")
    )

    stopping = decided("going to C", without_arm, [ahead("arm to B", WorkPhase.STOPPING)])
    assert (stopping.shares, stopping.stops) == ({}, [])
    assert stopping.refused[0] == Objection(
        number("arm to C"), Reason.CONFLICT, "arm", number("arm to B")
    )

    assert decided("going to C", without_arm).shares == {number("arm to C"): 1.0}


def test_unforeseen_result_is_wasted_when_overwritten() -> None:
    decision = decided("going to C", {**START, "arm": "B"}, [ahead("arm to B", WorkPhase.DONE)])
    assert decision.stops == [
        Objection(number("arm to B"), Reason.CONFLICT, "arm", number("arm to C"))
    ]
    assert decision.shares == {number("arm to C"): 1.0}


def test_unforeseen_result_lasts_as_long_as_the_current_state() -> None:
    """The arm was on its way to box B, which is occupied now. Nothing else moves the arm before the
    gripper opens.
    """
    with Coordination("lasting", facts=START) as machine:
        going = machine.state("going to B", base("B"))
        reach, greet = (
            machine.state("arm to B", arm("B", can_undo=True)),
            machine.state("greeting", drop("A")),
        )
        going.to(reach, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
        going.to(greet, likelihood=Perceived(BOX_B_FREE, negated=True))
        reach.to(going)
        greet.to(going)
        arm_a = machine.state("arm to A", arm("A"))
        going.to(arm_a, on="somebody comes")
        arm_a.to(greet)
    done = [EarlyWork(reach.number, WorkPhase.DONE)]

    def stops(current: str, free: float, *, is_new: bool) -> list[Objection]:
        return decided(
            current, {**START, "arm": "B"}, done, machine=machine, free=free, is_new=is_new
        ).stops

    assert stops("going to B", 0.0, is_new=False) == []
    assert stops("going to B", 0.0, is_new=True) == [Objection(reach.number, Reason.NOT_FORESEEN)]
    assert stops("going to B", 1.0, is_new=True) == [], "the path that was taken leads there"


def test_unforeseen_result_needs_no_search_of_the_machine() -> None:
    asked: list[str] = []

    def likely(situation: Situation) -> float:
        asked.append(situation.state)
        return 0.9

    with Coordination("long", facts=START) as machine:
        going, reach = machine.state("going to B", base("B")), machine.state("arm to B", arm("B"))
        waits = [machine.state(f"waiting {number}") for number in range(50)]
        going.to(reach, when=BOX_B_FREE, likelihood=Prior(0.1))
        going.to(waits[0], likelihood=Prior(0.9))
        for wait, following in zip(waits, [*waits[1:], machine.final("end")], strict=True):
            wait.to(following, on="go", likelihood=likely)
        reach.to(waits[0])
    automaton = machine.automaton(situation())
    done = [EarlyWork(reach.number, WorkPhase.DONE)]
    present = Present(going.number, {**START, "arm": "B"}, situation(), work=done)
    limits = PreviewLimits(horizon=3)
    assert (
        LookAhead(Discrete(0.5), limits, needed_later(machine)).decide(automaton, present).stops
        == []
    )
    assert len(asked) < 5


def test_failed_early_work_is_not_restarted_early() -> None:
    decision = decided(
        "going to B", {"base": "A", "holding": True}, [ahead("arm to B", WorkPhase.FAILED)]
    )
    assert decision.refused[0] == Objection(number("arm to B"), Reason.FAILED)
    assert (decision.shares, decision.stops) == ({}, [])


def watched(undo: bool) -> Coordination:
    """A machine with a branch that needs the arm where it is at the start."""
    with Coordination("watched", facts=START) as machine:
        going = machine.state("going to B", base("B"))
        reach = machine.state("arm to B", arm("B", can_undo=undo))
        greet = machine.state(
            "greeting", Activity(Do(MOVE_GRIPPER, "wave", GRIPPER), needs={"arm": "home"})
        )
        end = machine.final("end")
        going.to(reach)
        going.to(greet, on="somebody comes")
        greet.to(reach)
        reach.to(end)
    return machine


def test_branch_needing_old_value_forbids_irreversible_work() -> None:
    refused = decided("going to B", machine=watched(undo=False))
    assert refused.shares == {}
    assert refused.refused == [Objection(1, Reason.BRANCH, "arm", 2)]
    assert decided("going to B", machine=watched(undo=True)).shares == {1: 1.0}


def test_failing_branch_still_needs_the_old_value() -> None:
    """The arm is moved anew by greeting. But that needs the light; without it, the arm is looked at
    as it is.
    """
    with Coordination("dark", facts={**START, "light": "on"}) as machine:
        going = machine.state("going to B", base("B"))
        reach = machine.state("arm to B", arm("B"))
        greet = machine.state(
            "greeting",
            Activity(Do(MOVE_ARM, "wave", ARM), needs={"light": "on"}, makes={"arm": "up"}),
        )
        look = machine.state(
            "looking", Activity(Do(MOVE_GRIPPER, "look", GRIPPER), needs={"arm": "home"})
        )
        end = machine.final("end")
        going.to(reach)
        going.to(greet, on="somebody comes")
        reach.to(end)
        greet.to(end)
        greet.to(look, on="failed")
        look.to(end)
    assert needed_later(machine)[0] == {"light": 2, "arm": 2, "base": 1}
    assert decided("going to B", machine=machine).refused == [Objection(1, Reason.BRANCH, "arm", 2)]


def test_no_early_work_starts_on_wasted_facts() -> None:
    """The arm was moved for nothing, and is at B by chance. It may have to go back first."""
    machine = watched(undo=True)
    spoilt = decided("going to B", {**START, "arm": "B"}, machine=machine, spoilt=["arm"])
    assert spoilt.refused == [Objection(1, Reason.BRANCH, "arm", 2)]
    by_chance: dict[str, Fact] = {"base": "B", "arm": "B", "holding": True}
    assert decided("arm to B", by_chance, spoilt=["arm"], is_done=True).refused[0] == Objection(
        number("dropping at B"), Reason.NEEDS, "arm"
    )
    assert decided("arm to B", by_chance, is_done=True).shares == {number("dropping at B"): 1.0}


def test_restoring_work_blocks_its_state_and_agents() -> None:
    machine = watched(undo=False)
    home = EarlyWork(1, WorkPhase.RESTORING)
    assert decided("greeting", machine=machine, work=[home]).refused == [
        Objection(1, Reason.CONFLICT, other=1)
    ]
    restoring = decided(
        "going to C", {"base": "A", "holding": True}, [ahead("arm to B", WorkPhase.RESTORING)]
    )
    assert restoring.refused[0] == Objection(
        number("arm to C"), Reason.CONFLICT, "arm", number("arm to B")
    )


def lifting(**options: Any) -> Coordination:
    """A machine whose second activity changes what it needs."""
    lift = Activity(Do(MOVE_ARM, "up", ARM), needs={"arm": "home"}, makes={"arm": "up"}, **options)
    with Coordination("lifting", facts=START) as machine:
        going = machine.state("going to B", base("B"))
        up = machine.state("lifting", lift)
        end = machine.final("end")
        going.to(up)
        up.to(end)
    return machine


def test_running_activity_may_change_its_own_needs() -> None:
    machine = lifting(undo=Do(MOVE_ARM, "home", ARM))
    assert decided("going to B", machine=machine).shares == {1: 1.0}
    runs = decided("going to B", {"base": "A", "holding": True}, [EarlyWork(1)], machine=machine)
    assert (runs.stops, runs.refused) == ([], [])


def test_activity_changing_its_needs_must_be_undoable() -> None:
    assert decided("going to B", machine=lifting()).refused == [
        Objection(1, Reason.BRANCH, "arm", 1)
    ]


def test_early_result_of_a_later_state_meets_no_needs() -> None:
    """The camera could look at B now: the arm is there. But it is there for a later state."""
    look = Activity(Do(MOVE_GRIPPER, "look", GRIPPER), needs={"arm": "B"})
    with Coordination("later", facts={**START, "arm": "B"}) as machine:
        going = machine.state("going to B", base("B"))
        looking = machine.state("looking", look)
        reach = machine.state("arm to B", arm("B"))
        end = machine.final("end")
        going.to(looking)
        looking.to(reach)
        reach.to(end)
    done = EarlyWork(2, WorkPhase.DONE)
    decision = decided("going to B", {**START, "arm": "B"}, [done], machine=machine)
    assert decision.refused == [Objection(1, Reason.NEEDS, "arm")]
    assert decision.stops == [Objection(2, Reason.CONFLICT, "arm", 1)]


def reaching(likelihood: Prior | None, event: str = "done", *, progress: bool = False) -> Decision:
    """What starts while the first activity has no progress; if it fails, the machine gives up."""
    first = base("B") if progress else Activity(Do(MOVE_GRIPPER, "hold", GRIPPER))
    with Coordination("reaching", facts=START) as machine:
        going, reach = machine.state("going to B", first), machine.state("arm to B", arm("B"))
        going.to(reach, on=event)
        reach.to(machine.final("end"))
        going.to(machine.final("given up"), on="failed", likelihood=likelihood)
    policy = Discrete(0.5, lambda one: one.progress_of_current)
    return decided("going to B", progress=0.0, machine=machine, policy=policy)


def test_impossible_failure_opens_no_branch() -> None:
    """Nor does an activity without progress hold others back."""
    assert reaching(None).refused == [Objection(1, Reason.BRANCH, "arm", 3)]
    assert reaching(Prior(0.0)).shares == {1: 1.0}
    assert reaching(Prior(0.0), progress=True).refused == [Objection(1, Reason.UTILITY, other=0)]


def test_arrow_is_certain_beside_an_impossible_failure() -> None:
    assert reaching(Prior(0.0), "arrived").shares == {1: 1.0}
    assert reaching(None, "arrived").refused == [Objection(0, Reason.STEADY)], "that may never come"


def test_progress_before_crosses_compound_end_but_not_a_wait() -> None:
    with Coordination("passing", facts=START) as machine:
        with machine.compound("first") as first:
            going = machine.state("going to B", base("B"))
            gone = machine.final("gone")
            going.to(gone)
        reach = machine.state("arm to B", arm("B"))
        pause = machine.state("waiting")
        grip = machine.state("gripping", Activity(Do(MOVE_GRIPPER, "close", GRIPPER)))
        end = machine.final("end")
        first.to(reach)
        reach.to(pause)
        pause.to(grip, on="object seen", likelihood=Prior(0.9))
        grip.to(end)
    decision = decided("going to B", machine=machine)
    assert decision.shares == {reach.number: 1.0}
    arm_done = [EarlyWork(reach.number, WorkPhase.DONE)]
    decision = decided("going to B", {**START, "arm": "B"}, arm_done, machine=machine)
    assert decision.refused == [Objection(grip.number, Reason.UTILITY, other=pause.number)]


def test_undo_cost_counts_when_a_branch_may_need_it() -> None:
    """The arm costs 0.2, and as much again to undo."""
    policy = Discrete(0.3)
    with Coordination("costs", facts=START) as machine:
        going = machine.state("going to B", base("B"))
        reach = machine.state("arm to B", arm("B", can_undo=True))
        greet = machine.state(
            "greeting", Activity(Do(MOVE_GRIPPER, "wave", GRIPPER), needs={"arm": "home"})
        )
        end = machine.final("end")
        going.to(reach, likelihood=Prior(0.75))
        going.to(greet, on="somebody comes", likelihood=Prior(0.25))
        reach.to(end)
        greet.to(end)
    assert decided("going to B", machine=machine, policy=policy, progress=0.5).shares == {}, (
        "0.375 - 0.25 * 0.4"
    )
    assert decided("going to B", machine=machine, policy=policy, progress=0.6).shares == {1: 1.0}


def test_agent_capacity_limits_early_work() -> None:
    with Coordination("one arm", facts=START) as machine:
        look = machine.state("looking", Activity(Do(MOVE_ARM, "look", ARM)))
        point = machine.state("pointing", Activity(Do(MOVE_ARM, "point", ARM)))
        look.to(point)
        point.to(look)
    assert decided("looking", machine=machine).refused == [Objection(1, Reason.AGENT, "arm")]
    two = Agent("arm", tasks=2)
    with Coordination("a solver", facts=START) as machine:
        look = machine.state("looking", Activity(Do(MOVE_ARM, "look", two)))
        point = machine.state("pointing", Activity(Do(MOVE_ARM, "point", two)))
        grip = machine.state("gripping", Activity(Do(MOVE_ARM, "grip", two)))
        look.to(point)
        point.to(grip)
        grip.to(look)
    always = Discrete(0.0, progress_only)
    decision = decided("looking", machine=machine, policy=always)
    assert (decision.shares, decision.refused) == ({1: 1.0}, [Objection(2, Reason.AGENT, "arm")])
    later = decided("looking", machine=machine, policy=always, work=[EarlyWork(2)])
    assert later.stops == [Objection(2, Reason.AGENT, "arm")], (
        "an earlier one comes before one that runs"
    )
    assert later.shares == {}, "but only when that has ended"


# --- policies -------------------------------------------------------------------------------------

LIKELY = Candidate(
    state=1, index=1, likelihood=0.9, probability=0.9, progress_before=0.5, cost=0.4, undo_cost=0.6
)


def test_expected_gain_subtracts_the_cost_of_a_wrong_prediction() -> None:
    assert expected_gain(LIKELY) == pytest.approx(0.9 * 0.5 - 0.1 * (0.4 + 0.6))
    half_done = Candidate(1, 1, 0.9, 0.9, 0.5, 0.4, 0.6, progress=0.5, share=1.0)
    assert expected_gain(half_done) == pytest.approx(0.9 * 0.5 - 0.1 * 0.5 * (0.4 + 0.6))


def test_discrete_policy_keeps_running_work_at_low_progress() -> None:
    policy = Discrete(0.5)
    assert policy.share(LIKELY) == 0
    assert policy.share(Candidate(1, 1, 0.9, 0.9, 0.5, 0.4, 0.6, share=1.0)) == 1
    assert policy.share(Candidate(1, 1, 0.3, 0.3, 0.9, 0.4, 0.6, share=1.0)) == 0, (
        "but its path is unlikely now"
    )


def test_continuous_policy_starts_slowly() -> None:
    policy = Continuous(0.2, 0.7, progress_only)
    shares = [
        policy.share(Candidate(1, 1, 1, 1, before, 0)) for before in (0.1, 0.2, 0.3, 0.46, 0.7, 1.0)
    ]
    assert shares == [0, 0, 0.1, 0.5, 1, 1]


def test_speed_of_adaptable_work_follows_the_utility() -> None:
    slow = Activity(Do(MOVE_ARM, "B", ARM), adapt=lambda pose, share, _: f"{pose} at {share:.0%}")
    with Coordination("slow", facts=START) as machine:
        going = machine.state("going to B", base("B"))
        reach = machine.state("arm to B", slow)
        look = machine.state("looking", Activity(Do(MOVE_GRIPPER, "B", GRIPPER)))
        going.to(reach)
        reach.to(look)
        look.to(going)
    policy = Continuous(0.0, 1.0, progress_only)
    assert decided("going to B", machine=machine, progress=0.35, policy=policy).shares == {1: 0.3}
    runs = [EarlyWork(1, share=0.3, progress=0.9)]
    decision = decided("going to B", machine=machine, progress=0.75, policy=policy, work=runs)
    assert decision.shares == {1: 0.7}
    assert decision.refused == [Objection(2, Reason.UTILITY, other=1)], (
        "it has no slow way, so it waits for its full utility"
    )


@pytest.mark.parametrize("make", [lambda: Discrete(float("nan")), lambda: Continuous(0.5, 0.5)])
def test_invalid_policy_is_rejected(make: object) -> None:
    with pytest.raises(MisuseError, match="must be"):
        make()  # type: ignore[operator]

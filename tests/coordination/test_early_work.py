"""Decisions about early work: which activities start early, and which early work stops."""

from collections.abc import Sequence
from typing import Any

import pytest
from coordination.box_delivery import (
    ARM,
    BOX_B_FREE,
    DELIVER,
    GRIPPER,
    MOVE_ARM,
    MOVE_GRIPPER,
    START,
    arm,
    base,
    drop,
    number,
    situation,
)

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Candidate,
    Continuous,
    Coordination,
    Discrete,
    Do,
    Fact,
    Perceived,
    Policy,
    PreviewLimits,
    Prior,
    Situation,
    expected_gain,
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
from tca_module import MisuseError
from tca_wire.coordination import Objection, Reason


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


# --- early starts and stops -----------------------------------------------------------------------


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
    """The arm was moved to box B, which is occupied now. Until the gripper opens, no other activity
    moves the arm.
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
    evaluated: list[str] = []

    def likely(situation: Situation) -> float:
        evaluated.append(situation.state)
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
    assert len(evaluated) < 5


def test_failed_early_work_is_not_restarted_early() -> None:
    decision = decided(
        "going to B", {"base": "A", "holding": True}, [ahead("arm to B", WorkPhase.FAILED)]
    )
    assert decision.refused[0] == Objection(number("arm to B"), Reason.FAILED)
    assert (decision.shares, decision.stops) == ({}, [])


def watched(undo: bool) -> Coordination:
    """Return a machine with a branch that needs the arm in its initial place."""
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
    """Greeting moves the arm again, but may fail for want of light. Then looking needs the arm's
    old place.
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
    """The arm was moved in vain, and is at B by chance. It may have to return first."""
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
    """Return a machine whose second activity changes a fact that it needs."""
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
    """The arm is already at B, but for a later state. Looking must not rely on this place."""
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
    """Return the decision while the first activity has no progress. If this activity fails, the
    machine gives up.
    """
    first = base("B") if progress else Activity(Do(MOVE_GRIPPER, "hold", GRIPPER))
    with Coordination("reaching", facts=START) as machine:
        going, reach = machine.state("going to B", first), machine.state("arm to B", arm("B"))
        going.to(reach, on=event)
        reach.to(machine.final("end"))
        going.to(machine.final("given up"), on="failed", likelihood=likelihood)
    policy = Discrete(0.5, lambda one: one.progress_of_current)
    return decided("going to B", progress=0.0, machine=machine, policy=policy)


def test_impossible_failure_opens_no_branch() -> None:
    """An activity without a progress report does not hold back others, either."""
    assert reaching(None).refused == [Objection(1, Reason.BRANCH, "arm", 3)]
    assert reaching(Prior(0.0)).shares == {1: 1.0}
    assert reaching(Prior(0.0), progress=True).refused == [Objection(1, Reason.UTILITY, other=0)]


def test_arrow_is_certain_beside_an_impossible_failure() -> None:
    assert reaching(Prior(0.0), "arrived").shares == {1: 1.0}
    assert reaching(None, "arrived").refused == [Objection(0, Reason.STEADY)], (
        "its event may never come"
    )


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
    """Moving the arm costs 0.2, and so does undoing the move."""
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

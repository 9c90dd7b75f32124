"""Previews: the states that a machine will probably enter, up to a limit."""

import pytest
from coordination.box_delivery import DELIVER, LABELS, arm, number, situation
from coordination.drawn_machines import RandomAutomaton

from tca_behaviours.coordination import (
    Coordination,
    LikelyArrow,
    PreviewLimits,
    Prior,
    Situation,
    most_likely,
)
from tca_module import MisuseError
from tca_wire.coordination import Foreseen


def preview_labels(
    current: str, free: float | None = 1.0, limits: PreviewLimits | None = None
) -> list[str]:
    found = most_likely(
        DELIVER.automaton(situation(free)), number(current), limits or PreviewLimits()
    )
    return [LABELS[one.state] for one in found]


def test_preview_ends_at_a_waiting_state() -> None:
    way_back = ["tucking", "going to A", "homing", "waiting"]
    assert preview_labels("going to B") == ["arm to B", "dropping at B", "dropped at B", *way_back]
    assert preview_labels("going to B", free=0.3) == [
        "going to C",
        "arm to C",
        "dropping at C",
        *way_back,
    ]
    assert preview_labels("going to B", free=None) == [], "unknown"
    assert preview_labels("waiting") == [], "an event of others is not foreseen"


def test_preview_probabilities_multiply_along_the_path() -> None:
    first, second, *_ = most_likely(DELIVER.automaton(situation(0.75)), number("going to B"))
    assert first == Foreseen(number("arm to B"), 0.75, 0.75)
    assert second == Foreseen(number("dropping at B"), 1.0, 0.75)


def test_preview_ends_at_its_horizon() -> None:
    assert preview_labels("going to B", limits=PreviewLimits(horizon=2)) == [
        "arm to B",
        "dropping at B",
    ]


def test_preview_prefers_the_shorter_then_the_first_path() -> None:
    def arrows(*targets: int) -> list[LikelyArrow]:
        return [LikelyArrow("done", target, 1 / len(targets)) for target in targets]

    ends: dict[int, list[LikelyArrow]] = {8: [], 9: []}
    assert most_likely(RandomAutomaton({0: arrows(1, 9), 1: arrows(8), **ends}), 0) == [
        Foreseen(9, 0.5, 0.5)
    ]
    seen_late = RandomAutomaton(
        {
            0: [LikelyArrow("done", 1, 0.5), LikelyArrow("done", 3, 0.25)],
            1: arrows(2),
            2: [LikelyArrow("done", 8, 0.5), LikelyArrow("done", 0, 0.5)],
            3: arrows(9),
            **ends,
        }
    )
    assert [one.state for one in most_likely(seen_late, 0)] == [3, 9], "0.25, as that by 1 and 2"
    two_long = RandomAutomaton({0: arrows(1, 2), 1: arrows(8), 2: arrows(9), **ends})
    assert [one.state for one in most_likely(two_long, 0)] == [1, 8]
    unlike = RandomAutomaton(
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
    """The probability of this path is too small for a float."""
    length = 2000
    arrows = {state: [LikelyArrow("done", state + 1, 0.55)] for state in range(length)}
    for state in range(length - 1):
        arrows[state].append(LikelyArrow("short cut", state + 2, 0.45))
    found = most_likely(RandomAutomaton({**arrows, length: []}), 0)
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
    ("wrong", "message"),
    [
        ({"final": 0.0}, "final must be above 0, and 1 at most, not 0.0"),
        ({"transition": 1.0}, "transition must be 0 or more, and less than 1, not 1.0"),
        ({"horizon": 0}, "horizon must be 1 or more, or None for any number, not 0"),
    ],
)
def test_invalid_preview_limits_are_rejected(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(MisuseError, match=message):
        PreviewLimits(**wrong)  # type: ignore[arg-type]

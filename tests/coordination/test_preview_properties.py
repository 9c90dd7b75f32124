"""For any machine, the preview is the most probable path, and early work blocks no current
activity.
"""

from collections.abc import Iterator, Sequence
from random import Random

from coordination.drawn_machines import PlayedRun, RandomAutomaton, random_automaton
from hypothesis import given
from hypothesis import strategies as st

from tca_behaviours.coordination import (
    Continuous,
    Discrete,
    LikelyArrow,
    PreviewLimits,
    most_likely,
    progress_only,
)
from tca_wire.coordination import Foreseen


class MachineWithoutLikelihoods(RandomAutomaton):
    """A random automaton that has lost its likelihoods."""

    def __init__(self, machine: RandomAutomaton) -> None:
        super().__init__(machine.arrows, machine.activities)

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        return [arrow._replace(likelihood=0.0) for arrow in super().arcs(state)]


@st.composite
def automata(draw: st.DrawFn) -> RandomAutomaton:
    """Draw an automaton of up to six states with up to three arrows each. Likelihoods are eighths,
    so their products are exact, and often equal.
    """
    number = draw(st.integers(1, 6))
    arrows = {}
    for state in range(number):
        targets = draw(st.lists(st.integers(0, number - 1), max_size=3))
        left = 8
        arrows[state] = list[LikelyArrow]()
        for place, target in enumerate(targets):
            eighths = min(left, draw(st.sampled_from((0, 1, 2, 4, 4, 8))))
            left -= eighths
            arrows[state].append(LikelyArrow(str(place), target, eighths / 8))
    return RandomAutomaton(arrows)


LIMITS = st.builds(
    PreviewLimits,
    st.sampled_from((0.25, 0.5, 1.0)),
    st.sampled_from((0.0, 0.25, 0.5)),
    st.none() | st.integers(1, 5),
)


def is_steady(automaton: RandomAutomaton, state: int, limits: PreviewLimits) -> bool:
    likelihoods = [arrow.likelihood for arrow in automaton.arcs(state)]
    return 1 - sum(likelihoods) >= limits.final or all(
        one <= limits.transition for one in likelihoods
    )


def all_paths(
    automaton: RandomAutomaton, path: list[tuple[int, int, float]], limits: PreviewLimits
) -> Iterator[list[tuple[int, int, float]]]:
    """Yield all paths that end in a steady state or at the horizon. A path lists its states, each
    with the arrow and likelihood of its entry.

    Without a horizon no path visits a state twice. A second visit would only make the path less
    probable.
    """
    state = path[-1][0]
    if is_steady(automaton, state, limits) or len(path) - 1 == limits.horizon:
        yield path
        return
    for place, arrow in enumerate(automaton.arcs(state)):
        is_circle = any(arrow.target == entered for entered, _, _ in path)
        if arrow.likelihood > 0 and not (is_circle and limits.horizon is None):
            yield from all_paths(
                automaton, [*path, (arrow.target, place, arrow.likelihood)], limits
            )


def probability(path: list[tuple[int, int, float]]) -> float:
    product = 1.0
    for _, _, likelihood in path:
        product *= likelihood
    return product


@given(automata(), LIMITS)
def test_preview_agrees_with_a_search_of_all_paths(
    automaton: RandomAutomaton, limits: PreviewLimits
) -> None:
    paths = list(all_paths(automaton, [(0, 0, 1.0)], limits))
    if not paths:
        return
    best = min(
        paths, key=lambda path: (-probability(path), len(path), [place for _, place, _ in path])
    )
    assert most_likely(automaton, 0, limits) == [
        Foreseen(state, likelihood, probability(best[: place + 2]))
        for place, (state, _, likelihood) in enumerate(best[1:])
    ]


@given(automata(), LIMITS)
def test_preview_without_horizon_repeats_no_state(
    automaton: RandomAutomaton, limits: PreviewLimits
) -> None:
    found = [0, *(one.state for one in most_likely(automaton, 0, limits))]
    if limits.horizon is None:
        assert len(found) == len(set(found))
    else:
        assert len(found) <= limits.horizon + 1


@given(
    st.integers(0, 2**32),
    st.sampled_from((Discrete(0.0, progress_only), Discrete(0.3), Continuous(-0.5, 0.1))),
)
def test_early_work_never_blocks_the_current_activity(
    seed: int, policy: Discrete | Continuous
) -> None:
    random = Random(seed)
    run = PlayedRun(
        random_automaton(random),
        policy,
        random,
        PreviewLimits(0.6, horizon=random.choice((None, 4))),
    )
    for _ in range(60):
        run.step()


def test_played_runs_start_keep_and_restore_early_work() -> None:
    started = kept = restored = 0
    for seed in range(120):
        random = Random(seed)
        run = PlayedRun(random_automaton(random), Discrete(0.0, progress_only), random)
        for _ in range(60):
            run.step()
        started, kept, restored = started + run.started, kept + run.kept, restored + run.restored
    assert min(started, kept, restored) > 4, (started, kept, restored)


@given(st.integers(0, 2**32))
def test_no_early_work_starts_without_likelihoods(seed: int) -> None:
    random = Random(seed)
    run = PlayedRun(
        MachineWithoutLikelihoods(random_automaton(random)), Discrete(-1.0, progress_only), random
    )
    for _ in range(30):
        run.step()
    assert run.started == 0

"""What must be true of the regions of a component's model."""

from collections.abc import Iterator

from tca_behaviours.activities.components.states import RegionState, StateList
from tca_behaviours.activities.models.model import RegionModel, StateModel, TransitionModel
from tca_tools.user_toml import BadUserFile, advice


def check_estimate(place: str, period: float, estimate: float) -> None:
    """That a tick ends before the next is due. Raises BadUserFile."""
    if 0 < period < estimate:
        raise BadUserFile(f"{place}.estimate is longer than the period: divide the work into shorter steps")


def check_region(place: str, region: RegionModel, regions: dict[str, RegionModel]) -> None:
    """Raises BadUserFile for a region that can't be run."""
    check_estimate(place, region.period, region.estimate)
    above: dict[str, StateModel] = {}
    initial: dict[str, str] = {}
    for state in region.states:
        _check_state(f"{place}.states.{state.name}", state, above, initial)
        above[state.name] = state
    for number, transition in enumerate(region.transitions, 1):
        _check_transition(f"{place}.transitions.{number}", transition, region, regions)
    _check_reached(place, region)


def _check_state(place: str, state: StateModel, above: dict[str, StateModel], initial: dict[str, str]) -> None:
    if state.name in above:
        raise BadUserFile(f"{place}: there are two states '{state.name}': give one of them another name")
    if state.inside and state.inside not in above:
        raise BadUserFile(
            f"{place}: it stands inside '{state.inside}', which is no state above it: {advice(state.inside, above)}"
        )
    if state.initial:
        if other := initial.get(state.inside):
            raise BadUserFile(f"{place}: '{other}' is initial, too: leave one of them out")
        initial[state.inside] = state.name
    if state.activity and not state.period:
        raise BadUserFile(f"{place}.period is missing: activity '{state.activity}' needs a number of seconds above 0")
    check_estimate(place, state.period, state.estimate)
    if not state.activity and (state.period or state.estimate):
        raise BadUserFile(f'{place} has a period or estimate, and no activity: add activity = "METHOD"')


def _check_transition(
    place: str, transition: TransitionModel, region: RegionModel, regions: dict[str, RegionModel]
) -> None:
    names = [state.name for state in region.states]
    for end, name in (("from", transition.source), ("to", transition.target)):
        if name not in names:
            raise BadUserFile(f"{place}.{end}: region '{region.name}' has no state '{name}': {advice(name, names)}")
    if not (transition.on or transition.when or transition.needs):
        raise BadUserFile(f"{place} would be made at once: add on, when or needs")
    for need in transition.needs:
        other, _, state = need.partition(".")
        if other not in regions:
            raise BadUserFile(f"{place}.needs: '{need}': there is no region '{other}': {advice(other, regions)}")
        if state not in (known := [one.name for one in regions[other].states]):
            raise BadUserFile(
                f"{place}.needs: '{need}': region '{other}' has no state '{state}': {advice(state, known)}"
            )


def ordered(states: list[StateModel], inside: str = "") -> Iterator[StateModel]:
    """The states, the initial one of each level first; one that holds others comes before them."""
    beside = [state for state in states if state.inside == inside]
    for state in sorted(beside, key=lambda state: not state.initial):
        yield state
        yield from ordered(states, state.name)


def _check_reached(place: str, region: RegionModel) -> None:
    chart = StateList(region.name)
    made: dict[str, RegionState] = {}
    for state in ordered(region.states):
        made[state.name] = chart.new_state(state.name, made.get(state.inside))
    for transition in region.transitions:
        made[transition.source].to(made[transition.target], on=transition.on or "whatever")
    if lost := chart.unreached():
        raise BadUserFile(f"{place}.states.{lost[0].name} can't be reached: let a transition lead to it, or remove it")

"""The regions of a component's model as statecharts, and their checks."""

from collections.abc import Callable, Iterator
from functools import cache

from tca_behaviours.activities.components.region import Region
from tca_behaviours.activities.models.model import RegionModel, StateModel, TransitionModel
from tca_module import MisuseError
from tca_tools.errors import BadUserFile
from tca_tools.user_toml import check_known


def check_estimate(place: str, period: float, estimate: float) -> None:
    """Check that a tick ends before the next is due. Raises BadUserFile."""
    if 0 < period < estimate:
        raise BadUserFile(
            f"{place}.estimate is longer than the period: divide the work into shorter steps"
        )


def check_region(place: str, name: str, regions: dict[str, RegionModel]) -> None:
    """Raise BadUserFile if a region can't be run."""
    region = regions[name]
    check_estimate(place, region.period, region.estimate)
    earlier: dict[str, StateModel] = {}
    initial: dict[str, str] = {}
    for state in region.states:
        _check_state(f"{place}.states.{state.name}", state, earlier, initial)
        earlier[state.name] = state
    for number, transition in enumerate(region.transitions, 1):
        _check_transition(f"{place}.transitions.{number}", transition, region, regions)
    try:
        region_of(name, region).check()
    except MisuseError as error:
        raise BadUserFile(f"{place}: {error}") from None


def _check_state(
    place: str, state: StateModel, earlier: dict[str, StateModel], initial: dict[str, str]
) -> None:
    if state.inside:
        check_known(f"{place}.inside", "outer state", state.inside, earlier)
    if state.initial:
        if other := initial.get(state.inside):
            raise BadUserFile(f"{place}: '{other}' is initial, too: make only one of them initial")
        initial[state.inside] = state.name
    check_estimate(place, state.period, state.estimate)
    if not state.activity and (state.period or state.estimate):
        raise BadUserFile(
            f'{place} has a period or estimate, but no activity: add activity = "METHOD"'
        )


def _check_transition(
    place: str, transition: TransitionModel, region: RegionModel, regions: dict[str, RegionModel]
) -> None:
    names = [state.name for state in region.states]
    for end, name in (("from", transition.source), ("to", transition.target)):
        check_known(f"{place}.{end}", "state", name, names)
    if transition.after and (transition.on or transition.when or transition.needs):
        raise BadUserFile(f"{place} has after and a condition: write two transitions")
    for need in transition.needs:
        other, _, state = need.partition(".")
        at = f"{place}.needs '{need}'"
        check_known(at, "region", other, regions)
        check_known(at, "state", state, [known.name for known in regions[other].states])


def in_tree_order(states: list[StateModel], inside: str = "") -> Iterator[StateModel]:
    """Yield the states, each container before the states inside it.

    In each container the initial state comes first.
    """
    siblings = [state for state in states if state.inside == inside]
    for state in sorted(siblings, key=lambda state: not state.initial):
        yield state
        yield from in_tree_order(states, state.name)


def region_of(name: str, model: RegionModel) -> Region:
    """Return the region, with methods that do nothing. Raises MisuseError."""
    region = Region("", name, model.period, model.estimate)
    for state in in_tree_order(model.states):
        container = region.states[state.inside] if state.inside else region
        container.state(
            state.name,
            entry=_method(state.entry),
            exit=_method(state.exit),
            activity=_method(state.activity),
            period=state.period,
            estimate=state.estimate,
        )
    for transition in model.transitions:
        source, target = region.states[transition.source], region.states[transition.target]
        if transition.after:
            source.after(transition.after, target)
            continue
        source.to(
            target,
            on=transition.on,
            when=_method(transition.when),
            needs=transition.needs,
        )
    return region


@cache
def _method(name: str) -> Callable[[], bool] | None:
    """Return a method of that name. Equal names give the same method, as in the generated class."""

    def method() -> bool:
        return False

    method.__name__ = name
    return method if name else None

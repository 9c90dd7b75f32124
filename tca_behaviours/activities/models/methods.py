"""The methods that a component's model names, and that the user writes."""

from collections.abc import Iterator
from typing import NamedTuple

from tca_behaviours.activities.models.model import ComponentModel, StateModel


class Method(NamedTuple):
    """A method that the user writes, and one place in the model that names it."""

    name: str
    role: str
    place: str
    about: str
    """The docstring of the method."""
    argument: str = ""
    """The type of the method's argument; "" if the method has none."""

    @property
    def is_guard(self) -> bool:
        """Whether it returns a bool."""
        return self.role == GUARD

    @property
    def signature(self) -> str:
        """The first line of the method."""
        value = f", value: {self.argument}" if self.argument else ""
        return f"def {self.name}(self{value}) -> {'bool' if self.is_guard else 'None'}:"


PORT_METHOD, STEP, GUARD = "the method of a port", "a step", "a guard"


def methods(component: ComponentModel) -> Iterator[Method]:
    """Yield the methods of a component, one for each place that names it."""
    for port, input_ in component.inputs.items():
        about = f"A value has arrived at port '{port}'."
        yield Method(f"take_{port}", PORT_METHOD, f"inputs.{port}", about, input_.type)
    for name, region in component.regions.items():
        for state in region.states:
            yield from _of_state(name, state)
        for number, transition in enumerate(region.transitions, 1):
            if transition.when:
                about = (
                    f"Whether '{name}' may go from '{transition.source}' to '{transition.target}'."
                )
                yield Method(transition.when, GUARD, f"regions.{name}.transitions.{number}", about)


def _of_state(region: str, state: StateModel) -> Iterator[Method]:
    steps = {
        state.entry: f"'{region}' enters '{state.name}'.",
        state.exit: f"'{region}' leaves '{state.name}'.",
        state.activity: f"Called once a period while '{region}' is in '{state.name}'.",
    }
    for method, about in steps.items():
        if method:
            yield Method(method, STEP, f"regions.{region}.states.{state.name}", about)

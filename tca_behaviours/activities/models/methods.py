"""The methods that are written by hand, as a component's model asks for them."""

from collections.abc import Iterator
from typing import NamedTuple

from tca_behaviours.activities.models.model import ComponentModel, StateModel


class Method(NamedTuple):
    """A method, and one place of the model that names it."""

    name: str
    role: str
    place: str
    about: str
    """Its docstring."""
    takes: str = ""
    """The type of the value that it takes, if it takes one."""

    @property
    def is_guard(self) -> bool:
        """Whether it answers."""
        return self.role == GUARD

    @property
    def signature(self) -> str:
        """Its first line."""
        value = f", value: {self.takes}" if self.takes else ""
        return f"def {self.name}(self{value}) -> {'bool' if self.is_guard else 'None'}:"


TAKER, STEP, GUARD = "the method of a port", "a step", "a guard"


def methods(component: ComponentModel) -> Iterator[Method]:
    """All of a component, some of them several times."""
    for port, input_ in component.inputs.items():
        about = f"A value has arrived at port '{port}'."
        yield Method(f"take_{port}", TAKER, f"inputs.{port}", about, input_.type)
    for name, region in component.regions.items():
        for state in region.states:
            yield from _of_state(name, state)
        for number, one in enumerate(region.transitions, 1):
            if one.when:
                about = f"Whether '{name}' may go from '{one.source}' to '{one.target}'."
                yield Method(one.when, GUARD, f"regions.{name}.transitions.{number}", about)


def _of_state(region: str, state: StateModel) -> Iterator[Method]:
    steps = {
        state.entry: f"'{region}' has come to '{state.name}'.",
        state.exit: f"'{region}' leaves '{state.name}'.",
        state.activity: f"Once a period, while '{region}' is in '{state.name}'.",
    }
    for method, about in steps.items():
        if method:
            yield Method(method, STEP, f"regions.{region}.states.{state.name}", about)

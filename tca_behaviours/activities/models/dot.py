"""A model as a picture, in the language of Graphviz: the instances with their connections; then each component with its
ports, and its regions side by side. A dot leads to the state that is entered first.
"""

from collections.abc import Iterable, Iterator

from tca_behaviours.activities.components.region import every
from tca_behaviours.activities.models.model import ApplicationModel, ComponentModel
from tca_behaviours.activities.models.statecharts import region_of
from tca_tools.drawing.chart_dot import FAINT, LONGEST_LINE, LOOKS, chart_lines, small, text

_PORT = "#e3edf7"


def model_dot(model: ApplicationModel) -> str:
    """A directed graph of the model."""
    lines = list(_instances(model)) if model.instances else []
    for number, component in enumerate(model.components.values()):
        lines += _component(f"c{number}", component)
    return "digraph model {\n" + LOOKS + "\n".join(f"  {line}" for line in lines) + "\n}\n"


def _frame(name: str, label: str, looks: str, inside: Iterable[str]) -> Iterator[str]:
    yield f"subgraph cluster_{name} {{"
    yield f'  graph [label=<{label}>, style="{looks}", color="{FAINT}"];'
    yield from (f"  {line}" for line in inside)
    yield "}"


# --- instances -------------------------------------------------------------------------------------------------------


def _instances(model: ApplicationModel) -> Iterator[str]:
    numbers = {name: f"i{number}" for number, name in enumerate(model.instances)}
    yield from _frame("instances", f"<b>{text(model.name)}</b>", "invis", _boxes(model, numbers))
    for connection in model.connections:
        (sending, output), (taking, input_) = connection.source, connection.target
        ports = output if output == input_ else f"{output} to {input_}"
        yield f'{numbers[sending]} -> {numbers[taking]} [label=" {ports}"];'


def _boxes(model: ApplicationModel, numbers: dict[str, str]) -> Iterator[str]:
    for name, one in model.instances.items():
        values = [small(f"{field} = {value}") for field, value in one.data.items()]
        lines = [f"<b>{text(name)}</b>  {small(one.component)}", *values]
        yield f'{numbers[name]} [style=filled, fillcolor="{_PORT}", label=<{"<br/>".join(lines)}>];'


# --- components ------------------------------------------------------------------------------------------------------


def _component(name: str, component: ComponentModel) -> Iterator[str]:
    yield from _frame(name, f"<b>{text(component.name)}</b>", "rounded", _inside(name, component))


def _inside(name: str, component: ComponentModel) -> Iterator[str]:
    if component.inputs or component.outputs:
        yield f"{name}_ports [{_ports(component)}];"
    for number, region in enumerate(component.regions):
        region_name = f"{name}_r{number}"
        about = f"<b>{text(region.name)}</b>  {small(every(region.period, region.estimate))}"
        yield from _frame(region_name, about, "rounded,dashed", chart_lines(region_of(region).chart, region_name))
        if component.inputs or component.outputs:
            yield f"{name}_ports -> {region_name}begin [style=invis];"


def _ports(component: ComponentModel) -> str:
    inputs = [f"in: {port} ({input_.type}){_kept(input_.keep)}" for port, input_ in component.inputs.items()]
    outputs = [f"out: {port} ({kind})" for port, kind in component.outputs.items()]
    handler = [f"port handler {every(component.period, component.estimate)}"] if component.inputs else []
    left = '<br align="left"/>'
    lines = [*(text(line, LONGEST_LINE) for line in [*inputs, *outputs]), *map(small, handler)]
    return f'style=filled, fillcolor="{_PORT}", fontsize=10, label=<{left.join([*lines, ""])}>'


def _kept(keep: int) -> str:
    return f", keeps {keep}" if keep > 1 else ""

"""A model as a picture, in the language of Graphviz.

The picture shows the instances with their connections. Then it shows each component: its ports, and
its regions side by side. A dot leads to the state that is entered first.
"""

from collections.abc import Iterator

import msgspec

from tca_behaviours.activities.components.states import tick_text
from tca_behaviours.activities.models.model import ApplicationModel, ComponentModel
from tca_behaviours.activities.models.statecharts import region_of
from tca_tools.drawing.chart_dot import chart_lines, graph, small, text
from tca_wire.charts import ChartArrow, ChartState, MachineChart, StateKind


def model_dot(model: ApplicationModel) -> str:
    """Return a directed graph of the model."""
    return graph([*(_instances(model) if model.instances else ()), *chart_lines(_chart(model))])


# --- instances ------------------------------------------------------------------------------------


def _instances(model: ApplicationModel) -> Iterator[str]:
    numbers = {name: f"i{number}" for number, name in enumerate(model.instances)}
    yield f"subgraph cluster_instances {{ graph [label=<<b>{text(model.name)}</b>>, style=invis];"
    for name, instance in model.instances.items():
        values = [small(f"{field} = {value}") for field, value in instance.data.items()]
        lines = [f"<b>{text(name)}</b>  {small(instance.component)}", *values]
        yield f'{numbers[name]} [style=filled, fillcolor="#e3edf7", label=<{"<br/>".join(lines)}>];'
    yield "}"
    for connection in model.connections:
        (sender, output), (receiver, input_) = connection.source, connection.target
        ports = output if output == input_ else f"{output} to {input_}"
        yield f'{numbers[sender]} -> {numbers[receiver]} [label=" {ports}"];'


# --- components -----------------------------------------------------------------------------------


def _chart(model: ApplicationModel) -> MachineChart:
    """Return all components as one chart: components contain regions, and regions contain
    states.
    """
    states: list[ChartState] = []
    arrows: list[ChartArrow] = []
    for component, kind in model.components.items():
        outer = len(states)
        states.append(ChartState(component, StateKind.ALL, lines=list(_ports(kind))))
        for region, settings in kind.regions.items():
            states.append(
                ChartState(
                    region, StateKind.COMPOUND, outer, tick_text(settings.period, settings.estimate)
                )
            )
            first, chart = len(states), region_of(region, settings).chart
            arrows += [
                ChartArrow(arrow.source + first, arrow.target + first, arrow.symbol)
                for arrow in chart.arrows
            ]
            states += [
                msgspec.structs.replace(state, parent=state.parent + first)
                for state in chart.states
            ]
    return MachineChart(model.name, states, arrows)


def _ports(component: ComponentModel) -> Iterator[str]:
    for port, input_ in component.inputs.items():
        kept = f", keeps {input_.keep}" if input_.keep > 1 else ""
        yield f"in: {port} ({input_.type}){kept}"
    for port, kind in component.outputs.items():
        yield f"out: {port} ({kind})"
    if component.inputs:
        yield f"port handler {tick_text(component.period, component.estimate)}"

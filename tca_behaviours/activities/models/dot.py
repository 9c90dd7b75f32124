"""A model as a picture, in the language of Graphviz: the instances with their connections; then each component with its
ports, and its regions side by side. A dot leads to the state that is entered first.
"""

from collections.abc import Iterator
from html import escape

from tca_behaviours.activities.models.model import (
    ApplicationModel,
    ComponentModel,
    RegionModel,
    StateModel,
    TransitionModel,
)
from tca_behaviours.activities.models.statecharts import ordered
from tca_wire.text.measures import duration

_INK, _FAINT, _PORT = "#1f2933", "#52606d", "#e3edf7"
_LOOKS = f"""\
  graph [fontname="Helvetica,Arial,sans-serif", fontsize=12, fontcolor="{_INK}", labelloc=t, labeljust=l,
    bgcolor=white, pad=0.3, nodesep=0.35, ranksep=0.35, compound=true];
  node [shape=box, style="rounded,filled", fillcolor=white, fontname="Helvetica,Arial,sans-serif", fontsize=11,
    fontcolor="{_INK}", color="{_INK}", penwidth=1, margin="0.1,0.05", height=0.3];
  edge [fontname="Helvetica,Arial,sans-serif", fontsize=9, fontcolor="{_INK}", color="{_INK}", arrowsize=0.6];
"""
_POINT = f'shape=circle, label="", width=0.1, height=0.1, fixedsize=true, fillcolor="{_INK}"'


def model_dot(model: ApplicationModel) -> str:
    """A directed graph of the model."""
    lines = list(_instances(model)) if model.instances else []
    for number, component in enumerate(model.components.values()):
        lines += _component(f"c{number}", component)
    return "digraph model {\n" + _LOOKS + "\n".join(f"  {line}" for line in lines) + "\n}\n"


def _frame(name: str, label: str, looks: str, inside: Iterator[str]) -> Iterator[str]:
    yield f"subgraph cluster_{name} {{"
    yield f'  graph [label=<{label}>, style="{looks}", color="{_FAINT}"];'
    yield from (f"  {line}" for line in inside)
    yield "}"


def _faint(text: str) -> str:
    return f'<font point-size="9" color="{_FAINT}">{escape(text)}</font>'


# --- instances -------------------------------------------------------------------------------------------------------


def _instances(model: ApplicationModel) -> Iterator[str]:
    numbers = {name: f"i{number}" for number, name in enumerate(model.instances)}
    yield from _frame("instances", f"<b>{escape(model.name)}</b>", "invis", _boxes(model, numbers))
    for connection in model.connections:
        (sending, output), (taking, input_) = connection.source, connection.target
        ports = output if output == input_ else f"{output} to {input_}"
        yield f'{numbers[sending]} -> {numbers[taking]} [label=" {ports}"];'


def _boxes(model: ApplicationModel, numbers: dict[str, str]) -> Iterator[str]:
    for name, one in model.instances.items():
        values = [_faint(f"{field} = {value}") for field, value in one.data.items()]
        lines = [f"<b>{escape(name)}</b>  {_faint(one.component)}", *values]
        yield f'{numbers[name]} [style=filled, fillcolor="{_PORT}", label=<{"<br/>".join(lines)}>];'


# --- components ------------------------------------------------------------------------------------------------------


def _component(name: str, component: ComponentModel) -> Iterator[str]:
    yield from _frame(name, f"<b>{escape(component.name)}</b>", "rounded", _inside(name, component))


def _inside(name: str, component: ComponentModel) -> Iterator[str]:
    if component.inputs or component.outputs:
        yield f"{name}_ports [{_ports(component)}];"
    for number, region in enumerate(component.regions):
        region_name = f"{name}_r{number}"
        about = f"<b>{escape(region.name)}</b>  {_faint(_every(region.period, region.estimate))}"
        yield from _frame(region_name, about, "rounded,dashed", _region(region_name, region))
        if component.inputs or component.outputs:
            yield f"{name}_ports -> {region_name}_begin [style=invis];"


def _ports(component: ComponentModel) -> str:
    inputs = [f"in: {port} ({input_.type}){_kept(input_.keep)}" for port, input_ in component.inputs.items()]
    outputs = [f"out: {port} ({kind})" for port, kind in component.outputs.items()]
    handler = [f"port handler {_every(component.period, component.estimate)}"] if component.inputs else []
    left = '<br align="left"/>'
    lines = [*(escape(line) for line in [*inputs, *outputs]), *map(_faint, handler)]
    return f'style=filled, fillcolor="{_PORT}", fontsize=10, label=<{left.join([*lines, ""])}>'


def _kept(keep: int) -> str:
    return f", keeps {keep}" if keep > 1 else ""


def _every(period: float, estimate: float) -> str:
    return f"every {duration(period)}" + (f", takes {duration(estimate)}" if estimate else "")


# --- regions ---------------------------------------------------------------------------------------------------------


class _Nodes:
    """The states of a region as nodes: a leaf is one; a state that holds others is a frame, entered at a dot inside."""

    def __init__(self, name: str, region: RegionModel) -> None:
        self.states = {state.name: state for state in ordered(region.states)}
        self.order = {state: number for number, state in enumerate(self.states)}
        self._prefix = name

    def inside(self, outer: str) -> list[str]:
        return [state.name for state in self.states.values() if state.inside == outer]

    def frame(self, state: str) -> str:
        return f"{self._prefix}_s{self.order[state]}" if state else self._prefix

    def node(self, state: str) -> str:
        return f"{self.frame(state)}_begin" if not state or self.inside(state) else self.frame(state)

    def end(self, key: str, state: str, other: str) -> list[str]:
        """An arrow is cut at the frame of a state that holds others, unless its *other* end is inside."""
        while other and other != state:
            other = self.states[other].inside
        return [f"{key}=cluster_{self.frame(state)}"] if self.inside(state) and other != state else []


def _region(name: str, region: RegionModel) -> Iterator[str]:
    nodes = _Nodes(name, region)
    yield from _level(nodes, "")
    for one in region.transitions:  # an edge each: lines of one label read as what must be true together
        label = "<br/>".join(f"&#160;{escape(line)}" for line in _label(one))
        if nodes.order[one.source] < nodes.order[one.target]:
            yield _arrow(nodes, one.source, one.target, [f"label=<{label}>"])
        else:  # what is written first stands above
            yield _arrow(nodes, one.target, one.source, [f"label=<{label}>", "dir=back"])


def _level(nodes: _Nodes, outer: str) -> Iterator[str]:
    """The states that stand inside one, or at the top of the region."""
    yield f"{nodes.frame(outer)}_begin [{_POINT}];"
    for state in nodes.inside(outer):
        label = "<br/>".join(_about(nodes.states[state]))
        if nodes.inside(state):
            yield from _frame(nodes.frame(state), label, "rounded", _level(nodes, state))
        else:
            yield f"{nodes.frame(state)} [label=<{label}>];"
    first = nodes.inside(outer)[0]
    looks = nodes.end("lhead", first, "")
    yield f"{nodes.frame(outer)}_begin -> {nodes.node(first)} [{', '.join(looks)}];"


def _about(state: StateModel) -> Iterator[str]:
    yield f"<b>{escape(state.name)}</b>"
    if state.activity:
        yield _faint(f"{state.activity} {_every(state.period, state.estimate)}")
    if state.entry:
        yield _faint(f"entry: {state.entry}")
    if state.exit:
        yield _faint(f"exit: {state.exit}")


def _label(transition: TransitionModel) -> Iterator[str]:
    """The event, and below it in brackets what else must be true."""
    if transition.on:
        yield transition.on
    if conditions := [*filter(None, [transition.when]), *transition.needs]:
        yield from f"[{',|'.join(conditions)}]".split("|")


def _arrow(nodes: _Nodes, tail: str, head: str, looks: list[str]) -> str:
    looks = [*looks, *nodes.end("ltail", tail, head), *nodes.end("lhead", head, tail)]
    return f"{nodes.node(tail)} -> {nodes.node(head)} [{', '.join(looks)}];"

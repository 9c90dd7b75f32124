"""A state machine of tasks as a picture, in the language of Graphviz.

Tasks are boxes, and containers are frames around them. A dot is where a container begins, a ring where it has
completed. In the SVG the state of number 3 has the id "state-3", and those that are active the class "active".
"""

from collections.abc import Collection, Iterator

from tca_tools.drawing.dot import FAINT, INK, LONGEST_NAME, LOOKS, NOWHERE, POINT, frames, head, tail, text
from tca_wire.charts import ChartState, Ending, MachineChart, StateKind

_ACTIVE, _ACTIVE_FRAME = "#ffcf70", "#c77700"
_COLOURS: dict[Ending, str] = {"completed": INK, "failed": "#b3261e", "timeout": "#8a6d00", "interrupted": "#7b3fa0"}
"""The colours of arrows, by the ending that they stand for."""
_LONGEST_PARAMETER, _MOST_PARAMETERS = 36, 6


def chart_dot(chart: MachineChart, active: Collection[int] = ()) -> str:
    """A directed graph of the machine; the states whose numbers are in *active* stand out."""
    lines = [f"  {line}" for line in _frame(chart, 0, active)]
    lines += [f"  {line}" for line in _arrows(chart)]
    return "digraph machine {\n" + LOOKS + "\n".join(lines) + "\n}\n"


def _frame(chart: MachineChart, number: int, active: Collection[int]) -> Iterator[str]:
    """A container, with all that is inside."""
    state = chart.states[number]
    inside = chart.inside(number)
    is_active = number in active
    style = "rounded,dashed" if state.kind.is_concurrent else "rounded"
    looks = f'color="{_ACTIVE_FRAME}", penwidth=2' if is_active else f'color="{FAINT}", penwidth=1'
    kind = f'  <font point-size="10" color="{FAINT}">{state.kind}</font>' if _says_kind(state) else ""
    yield f"subgraph cluster_{number} {{"
    # what is not said here would be taken from the frame around
    yield f'  graph [{_id(number, is_active)}, style="{style}", {looks},'
    yield f"    label=<<b>{text(state.label, LONGEST_NAME)}</b>{kind}>];"
    if state.kind.is_concurrent:
        yield f"  begin_{number} [{NOWHERE}];"
    else:
        yield f'  begin_{number} [{POINT}, fillcolor="{INK}"];'
    for inner in inside:
        rows = _frame(chart, inner, active) if chart.states[inner].kind.is_container else _node(chart, inner, active)
        yield from (f"  {row}" for row in rows)
    if _shows_end(chart, number):
        yield f"  end_{number} [{POINT}, fillcolor=white, peripheries=2];"
    else:
        yield f"  end_{number} [{NOWHERE}];"
    yield "}"


def _says_kind(state: ChartState) -> bool:
    return state.label.rstrip("0123456789 ") != state.kind


def _node(chart: MachineChart, number: int, active: Collection[int]) -> Iterator[str]:
    state = chart.states[number]
    is_active = number in active
    fill = f', fillcolor="{_ACTIVE}", penwidth=2' if is_active else ""
    if state.kind is StateKind.EPSILON:
        looks = f"shape=ellipse, style=filled, fontsize=10, label=<{text(state.label, LONGEST_NAME)}>"
    else:
        looks = f"label=<{'<br/>'.join(_lines(state))}>"
    yield f"s{number} [{_id(number, is_active)}, {looks}{fill}];"


def _lines(state: ChartState) -> Iterator[str]:
    name = text(state.label, LONGEST_NAME)
    is_named = state.label.rstrip("0123456789 ") != state.task
    task = f' <font color="{FAINT}">{text(state.task, LONGEST_NAME)}</font>' if is_named else ""
    yield f"<b>{name}</b>{task}"
    shown = list(state.parameters.items())
    for key, value in shown[:_MOST_PARAMETERS]:
        yield f'<font point-size="9" color="{FAINT}">{text(f"{key} = {value}", _LONGEST_PARAMETER)}</font>'
    if len(shown) > _MOST_PARAMETERS:
        yield f'<font point-size="9" color="{FAINT}">and {len(shown) - _MOST_PARAMETERS} more</font>'


def _arrows(chart: MachineChart) -> Iterator[str]:
    for number, state in enumerate(chart.states):
        inside = chart.inside(number)
        if state.kind.is_concurrent:  # they stand below its beginning, and above its end
            for inner in inside:
                yield f"begin_{number} -> {head(chart.states, inner)} [style=invis];"
                yield f"{tail(chart.states, inner)} -> end_{number} [style=invis];"
        elif inside:
            cut = frames(chart.states, -1, inside[0])
            yield _arrow(f"begin_{number}", head(chart.states, inside[0]), "completed", cut)
            if not _shows_end(chart, number):
                yield f"{tail(chart.states, inside[-1])} -> end_{number} [style=invis];"
        for ending, target in state.next.items():  # an arrow each, in its colour
            source, to = tail(chart.states, number), head(chart.states, target)
            if target > number:
                yield _arrow(source, to, ending, frames(chart.states, number, target))
            else:  # what is written first stands above
                yield _arrow(to, source, ending, ["dir=back", *frames(chart.states, target, number)])
        if "completed" in state.ends and "completed" not in state.next and _ends_container(chart, state):
            end = f"end_{state.parent}"
            yield _arrow(tail(chart.states, number), end, "completed", frames(chart.states, number, -1))


def _arrow(source: str, target: str, ending: Ending, looks: list[str]) -> str:
    looks = [*looks, f'color="{_COLOURS[ending]}"']
    if ending != "completed":
        looks.append(f'label="{ending}", fontcolor="{_COLOURS[ending]}", style=dashed')
    return f"{source} -> {target} [{', '.join(looks)}];"


def _ends_container(chart: MachineChart, state: ChartState) -> bool:
    return state.parent >= 0 and _shows_end(chart, state.parent)


def _shows_end(chart: MachineChart, number: int) -> bool:
    """Whether a container has a ring: some state in it completes the whole."""
    state = chart.states[number]
    return not state.kind.is_concurrent and "completed" in state.ends


def _id(number: int, is_active: bool) -> str:
    return f'id="state-{number}", class="{"active" if is_active else ""}"'

"""A state machine of tasks as a picture, in the language of Graphviz.

Tasks are boxes, and containers are frames around them. A dot is where a container begins, a ring where it has
completed. In the SVG the state of number 3 has the id "state-3", and those that are active the class "active".
"""

from collections.abc import Collection, Iterator
from html import escape

from tca_tools.terminal import cut
from tca_wire.charts import ChartState, Ending, MachineChart, StateKind
from tca_wire.text.printable import printable

_INK, _FAINT, _ACTIVE, _ACTIVE_FRAME = "#1f2933", "#52606d", "#ffcf70", "#c77700"
_COLOURS: dict[Ending, str] = {"completed": _INK, "failed": "#b3261e", "timeout": "#8a6d00", "interrupted": "#7b3fa0"}
"""The colours of arrows, by the ending that they stand for."""
_LONGEST_NAME, _LONGEST_PARAMETER, _MOST_PARAMETERS = 36, 36, 6
_LOOKS = f"""\
  graph [fontname="Helvetica,Arial,sans-serif", fontsize=12, fontcolor="{_INK}", labelloc=t, labeljust=l,
    bgcolor=white, pad=0.3, nodesep=0.4, ranksep=0.4, compound=true];
  node [shape=box, style="rounded,filled", fillcolor=white, fontname="Helvetica,Arial,sans-serif", fontsize=12,
    fontcolor="{_INK}", color="{_INK}", penwidth=1, margin="0.12,0.06", height=0.3];
  edge [fontname="Helvetica,Arial,sans-serif", fontsize=10, penwidth=1, arrowsize=0.7];
"""
_POINT = f'shape=circle, label="", width=0.11, height=0.11, fixedsize=true, color="{_INK}"'
_NOWHERE = 'shape=point, width=0.01, height=0.01, style=invis, label=""'


def chart_dot(chart: MachineChart, active: Collection[int] = ()) -> str:
    """A directed graph of the machine; the states whose numbers are in *active* stand out."""
    lines = [f"  {line}" for line in _frame(chart, 0, active)]
    lines += [f"  {line}" for line in _arrows(chart)]
    return "digraph machine {\n" + _LOOKS + "\n".join(lines) + "\n}\n"


def _frame(chart: MachineChart, number: int, active: Collection[int]) -> Iterator[str]:
    """A container, with all that is inside."""
    state = chart.states[number]
    inside = chart.inside(number)
    is_active = number in active
    style = "rounded,dashed" if state.kind.is_concurrent else "rounded"
    looks = f'color="{_ACTIVE_FRAME}", penwidth=2' if is_active else f'color="{_FAINT}", penwidth=1'
    kind = f'  <font point-size="10" color="{_FAINT}">{state.kind}</font>' if _says_kind(state) else ""
    yield f"subgraph cluster_{number} {{"
    # what is not said here would be taken from the frame around
    yield f'  graph [{_id(number, is_active)}, style="{style}", {looks},'
    yield f"    label=<<b>{_text(state.label, _LONGEST_NAME)}</b>{kind}>];"
    if state.kind.is_concurrent:
        yield f"  begin_{number} [{_NOWHERE}];"
    else:
        yield f'  begin_{number} [{_POINT}, fillcolor="{_INK}"];'
    for inner in inside:
        rows = _frame(chart, inner, active) if chart.states[inner].kind.is_container else _node(chart, inner, active)
        yield from (f"  {row}" for row in rows)
    if _shows_end(chart, number):
        yield f"  end_{number} [{_POINT}, fillcolor=white, peripheries=2];"
    else:
        yield f"  end_{number} [{_NOWHERE}];"
    yield "}"


def _says_kind(state: ChartState) -> bool:
    return state.label.rstrip("0123456789 ") != state.kind


def _node(chart: MachineChart, number: int, active: Collection[int]) -> Iterator[str]:
    state = chart.states[number]
    is_active = number in active
    fill = f', fillcolor="{_ACTIVE}", penwidth=2' if is_active else ""
    if state.kind is StateKind.EPSILON:
        looks = f"shape=ellipse, style=filled, fontsize=10, label=<{_text(state.label, _LONGEST_NAME)}>"
    else:
        looks = f"label=<{'<br/>'.join(_lines(state))}>"
    yield f"s{number} [{_id(number, is_active)}, {looks}{fill}];"


def _lines(state: ChartState) -> Iterator[str]:
    name = _text(state.label, _LONGEST_NAME)
    is_named = state.label.rstrip("0123456789 ") != state.task
    task = f' <font color="{_FAINT}">{_text(state.task, _LONGEST_NAME)}</font>' if is_named else ""
    yield f"<b>{name}</b>{task}"
    shown = list(state.parameters.items())
    for key, value in shown[:_MOST_PARAMETERS]:
        yield f'<font point-size="9" color="{_FAINT}">{_text(f"{key} = {value}", _LONGEST_PARAMETER)}</font>'
    if len(shown) > _MOST_PARAMETERS:
        yield f'<font point-size="9" color="{_FAINT}">and {len(shown) - _MOST_PARAMETERS} more</font>'


def _arrows(chart: MachineChart) -> Iterator[str]:
    for number, state in enumerate(chart.states):
        inside = chart.inside(number)
        if state.kind.is_concurrent:  # they stand below its beginning, and above its end
            for inner in inside:
                yield f"begin_{number} -> {_head(chart, inner)} [style=invis];"
                yield f"{_tail(chart, inner)} -> end_{number} [style=invis];"
        elif inside:
            yield _arrow(f"begin_{number}", _head(chart, inside[0]), [], _frames(chart, -1, inside[0]))
            if not _shows_end(chart, number):
                yield f"{_tail(chart, inside[-1])} -> end_{number} [style=invis];"
        for target in dict.fromkeys(state.next.values()):
            endings = [ending for ending, to in state.next.items() if to == target]
            tail, head = _tail(chart, number), _head(chart, target)
            if target > number:
                yield _arrow(tail, head, endings, _frames(chart, number, target))
            else:  # what is written first stands above
                yield _arrow(head, tail, endings, ["dir=back", *_frames(chart, target, number)])
        if "completed" in state.ends and "completed" not in state.next and _ends_container(chart, state):
            yield _arrow(_tail(chart, number), f"end_{state.parent}", [], _frames(chart, number, -1))


def _arrow(tail: str, head: str, endings: list[Ending], looks: list[str]) -> str:
    colour = _COLOURS[endings[-1]] if endings else _INK
    looks = [*looks, f'color="{colour}"']
    if any(look.startswith("lhead") for look in looks):
        looks.append("minlen=2")  # room for its head before the frame
    if endings not in ([], ["completed"]):
        looks.append(f'label="{", ".join(endings)}", fontcolor="{colour}"')
        looks += ["style=dashed"] * ("completed" not in endings)
    return f"{tail} -> {head} [{', '.join(looks)}];"


def _head(chart: MachineChart, number: int) -> str:
    """The node where an arrow to a state ends; of a container the one that stands for its frame."""
    return f"begin_{number}" if chart.states[number].kind.is_container else f"s{number}"


def _tail(chart: MachineChart, number: int) -> str:
    """The node where an arrow out of a state begins."""
    return f"end_{number}" if chart.states[number].kind.is_container else f"s{number}"


def _frames(chart: MachineChart, tail: int, head: int) -> list[str]:
    """The frames at which an arrow is cut; none that holds both its ends."""
    return [
        f"{key}=cluster_{number}"
        for key, number, other in (("ltail", tail, head), ("lhead", head, tail))
        if number >= 0 and chart.states[number].kind.is_container and number not in _around(chart, other)
    ]


def _around(chart: MachineChart, number: int) -> Iterator[int]:
    """A state, and the containers that it stands in."""
    while number >= 0:
        yield number
        number = chart.states[number].parent


def _ends_container(chart: MachineChart, state: ChartState) -> bool:
    return state.parent >= 0 and _shows_end(chart, state.parent)


def _shows_end(chart: MachineChart, number: int) -> bool:
    """Whether a container has a ring: some state in it completes the whole."""
    state = chart.states[number]
    return not state.kind.is_concurrent and "completed" in state.ends


def _id(number: int, is_active: bool) -> str:
    return f'id="state-{number}", class="{"active" if is_active else ""}"'


def _text(words: str, longest: int) -> str:
    return escape(cut(printable(words), longest)) or "?"

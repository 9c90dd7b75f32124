"""A coordination machine as a picture, in the language of Graphviz.

States are boxes with their tasks, and compounds are frames around them. A dot is where a machine or a compound begins;
a double frame is a final state. As in the paper, the current state is green, and those that it foresees are yellow,
with the likelihoods at the arrows that lead to them. In the SVG the state of number 3 has the id "state-3", and the
class "current" or "foreseen".
"""

from collections.abc import Iterator
from itertools import pairwise

from tca_tools.drawing.dot import FAINT, INK, LONGEST_NAME, LOOKS, NOWHERE, POINT, frames, head, tail, text
from tca_wire.coordination import ActivityKind, CoordinationChart, CoordinationReport
from tca_wire.text.measures import percent

_FILLS = {"current": "#9fdc8f", "foreseen": "#ffe27a"}
_LIKELY = "#9a6b00"
_LONGEST_TASK = 48


def coordination_dot(chart: CoordinationChart, report: CoordinationReport | None = None) -> str:
    """A directed graph of the machine; with a report of a run, its current state and those that it foresees."""
    picture = _Picture(chart, report)
    lines = [f'begin [{POINT}, fillcolor="{INK}"];', *picture.inside(-1), *picture.arrows()]
    return "digraph machine {\n" + LOOKS + "".join(f"  {line}\n" for line in lines) + "}\n"


def likely_arrows(chart: CoordinationChart, report: CoordinationReport) -> dict[int, str]:
    """The arrows on the path that is foreseen, by their places in the chart: their likelihoods in words."""
    foreseen = {row.state: percent(row.likelihood) for row in reversed(report.preview)}
    path = [report.current, *(row.state for row in report.preview)]
    steps = set(pairwise(number for number in path if 0 <= number < len(chart.states)))
    return {
        place: foreseen[after]
        for place, arrow in enumerate(chart.arrows)
        for before, after in steps
        if after == _entered(chart, arrow.target) and _leaves(chart, before, arrow.source)
    }


def _entered(chart: CoordinationChart, target: int) -> int:
    """The state that is entered with one: of a compound the first inside."""
    while chart.states[target].kind.is_container:
        target = chart.inside(target)[0]
    return target


def _leaves(chart: CoordinationChart, state: int, source: int) -> bool:
    """Whether an arrow from *source* leaves a state."""
    while state not in (source, -1):
        state = chart.states[state].parent
    return state == source


class _Picture:
    def __init__(self, chart: CoordinationChart, report: CoordinationReport | None) -> None:
        self.chart = chart
        self.states = chart.states
        self.current = report.current if report is not None else -1
        self.foreseen = {row.state for row in report.preview} if report is not None else set[int]()
        self.likely = likely_arrows(chart, report) if report is not None else {}

    def inside(self, number: int) -> Iterator[str]:
        """The states that stand in one; of -1, in none."""
        for inner in self.chart.inside(number):
            yield from self._frame(inner) if self.states[inner].kind.is_container else self._node(inner)

    def _frame(self, number: int) -> Iterator[str]:
        yield f"subgraph cluster_{number} {{"
        yield f'  graph [id="state-{number}", class="", style=rounded, color="{FAINT}",'
        yield f"    label=<<b>{text(self.states[number].label, LONGEST_NAME)}</b>>];"
        yield f'  begin_{number} [{POINT}, fillcolor="{INK}"];'
        yield from (f"  {line}" for line in self.inside(number))
        yield f"  end_{number} [{NOWHERE}];"
        yield "}"

    def _node(self, number: int) -> Iterator[str]:
        state = self.states[number]
        place = "current" if number == self.current else "foreseen" if number in self.foreseen else ""
        fill = f', fillcolor="{_FILLS[place]}"' if place else ""
        name = text(state.label, LONGEST_NAME)
        if state.kind is ActivityKind.FINAL:
            looks = f"peripheries=2, fontsize=10, label=<{name}>"
        else:
            tasks = [
                f'<font point-size="9" color="{FAINT}">{text(task, _LONGEST_TASK)}{self._agents(agents)}</font>'
                for task, agents in zip(state.tasks, state.agents, strict=True)
            ]
            looks = f"label=<{'<br/>'.join([f'<b>{name}</b>', *tasks])}>"
        yield f's{number} [id="state-{number}", class="{place}", {looks}{fill}];'

    def _agents(self, agents: str) -> str:
        return f" ({text(agents, LONGEST_NAME)})" if agents else ""

    def arrows(self) -> Iterator[str]:
        """All arrows, those to first states too."""
        for number in [-1, *(number for number, state in enumerate(self.states) if state.kind.is_container)]:
            first = self.chart.inside(number)[0]
            begin = f"begin_{number}" if number >= 0 else "begin"
            yield self._drawn(begin, head(self.states, first), frames(self.states, -1, first))
            if number >= 0:
                last = self.chart.inside(number)[-1]
                yield f"{tail(self.states, last)} -> end_{number} [style=invis];"
        for place, arrow in enumerate(self.chart.arrows):
            source, target = tail(self.states, arrow.source), head(self.states, arrow.target)
            words = text(arrow.symbol, LONGEST_NAME)
            looks = [f'id="arrow-{place}"']
            if likely := self.likely.get(place):
                words += f"<br/><b>{likely}</b>"
                looks += [f'color="{_LIKELY}"', f'fontcolor="{_LIKELY}"', "penwidth=2"]
            looks.append(f"label=<&#160;{words}&#160;>")
            if arrow.target > arrow.source:
                yield self._drawn(source, target, [*looks, *frames(self.states, arrow.source, arrow.target)])
            else:  # what is written first stands above
                cut = frames(self.states, arrow.target, arrow.source)
                yield self._drawn(target, source, [*looks, "dir=back", *cut])

    def _drawn(self, source: str, target: str, looks: list[str]) -> str:
        return f"{source} -> {target} [{', '.join(looks)}];"

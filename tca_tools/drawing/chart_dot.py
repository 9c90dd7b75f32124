"""A state machine as a picture, in the language of Graphviz.

States are boxes with their activities, and containers are frames around them. A dot is the start of
a machine or container, a ring the completion of a container; a double frame is a final state. In
the SVG, state number 3 has the id "state-3", and may have the class "active", "current" or
"foreseen".
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from html import escape
from itertools import pairwise

from tca_tools.terminal import cut
from tca_wire.charts import ChartState, MachineChart, StateKind
from tca_wire.coordination import CoordinationReport
from tca_wire.text.measures import percent
from tca_wire.text.printable import printable

INK, FAINT = "#1f2933", "#52606d"
_LOOKS = f"""\
  graph [fontname="Helvetica,Arial,sans-serif", fontsize=12, fontcolor="{INK}", \
labelloc=t, labeljust=l,
    bgcolor=white, pad=0.3, nodesep=0.4, ranksep=0.4, compound=true];
  node [shape=box, style="rounded,filled", fillcolor=white, \
fontname="Helvetica,Arial,sans-serif", fontsize=12,
    fontcolor="{INK}", color="{INK}", penwidth=1, margin="0.12,0.06", height=0.3];
  edge [fontname="Helvetica,Arial,sans-serif", fontsize=10, penwidth=1, arrowsize=0.7,
    fontcolor="{INK}", color="{INK}"];
"""
_BEGIN = (
    f'{{}} [shape=circle, label="", width=0.11, height=0.11, fixedsize=true, fillcolor="{INK}"];'
)
_RING = '{} [shape=circle, label="", width=0.11, height=0.11, fixedsize=true, peripheries=2];'
_NOWHERE = '{} [shape=point, width=0.01, height=0.01, style=invis, label=""];'
_SHAPES = {
    StateKind.FINAL: "peripheries=2,",
    StateKind.EPSILON: "shape=ellipse, style=filled,",
}
_LEFT = '<br align="left"/>'
_FILLS = {"active": "#ffcf70", "current": "#9fdc8f", "foreseen": "#ffe27a"}
_ACTIVE_FRAME, _LIKELY = "#c77700", "#9a6b00"
_COLOURS = {"failed": "#b3261e", "timeout": "#8a6d00", "interrupted": "#7b3fa0"}
"""The colours of arrows for endings other than success."""
_LONGEST, _LONGEST_LINE = 36, 88


def chart_dot(
    chart: MachineChart,
    marks: Mapping[int, str] | None = None,
    likely: Mapping[int, str] | None = None,
) -> str:
    """Return a directed graph of a machine.

    Args:
        chart: The machine.
        marks: The classes of highlighted states, by number.
        likely: The likelihoods of highlighted arrows, in words, by index.
    """
    return graph(_Picture(chart, marks or {}, likely or {}).lines())


def graph(lines: Iterable[str], name: str = "machine") -> str:
    """Return a directed graph in the common style."""
    return f"digraph {name} {{\n" + _LOOKS + "".join(f"  {line}\n" for line in lines) + "}\n"


def chart_lines(chart: MachineChart) -> Iterator[str]:
    """Yield the lines of a machine for a larger graph."""
    return _Picture(chart, {}, {}).lines()


def report_marks(report: CoordinationReport) -> dict[int, str]:
    """Return the marks of a run with a preview: its current state and the foreseen ones."""
    return {**{row.state: "foreseen" for row in report.preview}, report.current: "current"}


def likely_arrows(chart: MachineChart, report: CoordinationReport) -> dict[int, str]:
    """Return the likelihoods in words of the arrows on the foreseen path, by index in the chart."""
    foreseen = {row.state: percent(row.likelihood) for row in reversed(report.preview)}
    path = [report.current, *(row.state for row in report.preview)]
    steps = set(pairwise(number for number in path if 0 <= number < len(chart.states)))
    return {
        place: foreseen[after]
        for place, arrow in enumerate(chart.arrows)
        for before, after in steps
        if after == chart.entered(arrow.target) and arrow.source in chart.around(before)
    }


def text(words: str, longest: int = _LONGEST) -> str:
    """Return words for an HTML label, cut to a length."""
    return escape(cut(printable(words), longest)) or "?"


def small(words: str, colour: str = FAINT) -> str:
    """Return a line of an HTML label in small print."""
    return f'<font point-size="9" color="{colour}">{text(words, _LONGEST_LINE)}</font>'


def quoted(*lines: str) -> str:
    """Return lines as a quoted text, for a label that is not HTML."""
    safe = (printable(line).replace("\\", "\\\\").replace('"', '\\"') for line in lines)
    return '"' + "\\n".join(safe) + '"'


@dataclass(frozen=True)
class _Picture:
    chart: MachineChart
    marks: Mapping[int, str]
    likely: Mapping[int, str]

    def lines(self) -> Iterator[str]:
        """Yield all states, then all arrows."""
        tops = self.chart.inside(-1)
        whole = self.chart.states[0].kind
        # A coordination machine has no frame around it
        if whole in (StateKind.ACTIVITY, StateKind.WAIT, StateKind.COMPOUND):
            yield _BEGIN.format("begin")
            yield self._arrow("begin", self._head(tops[0]), self._cut(-1, tops[0]))
        for top in tops:
            yield from self._state(top)
        for number in range(len(self.chart.states)):
            yield from self._inner_arrows(number)
        for place in range(len(self.chart.arrows)):
            yield self._transition(place)

    # --- states -----------------------------------------------------------------------------------

    def _state(self, number: int) -> Iterator[str]:
        state, mark = self.chart.states[number], self.marks.get(number, "")
        names = f'id="state-{number}", class="{mark}"'
        if not self._is_frame(number):
            fill = f'fillcolor="{_FILLS[mark]}", penwidth=2' if mark else ""
            label, shape = _label(state, "<br/>"), _SHAPES.get(state.kind, "")
            yield f"s{number} [{names}, label=<{label}>, {shape} {fill}];"
            return
        style = "rounded,dashed" if state.kind.is_concurrent else "rounded"
        looks = f'color="{_ACTIVE_FRAME}", penwidth=2' if mark else f'color="{FAINT}", penwidth=1'
        yield f'subgraph cluster_{number} {{ graph [{names}, style="{style}", {looks},'
        yield f"  label=<{_label(state, _LEFT)}{_LEFT}>];"
        yield (_NOWHERE if state.kind.is_concurrent else _BEGIN).format(f"begin_{number}")
        for inner in self.chart.inside(number):
            yield from self._state(inner)
        yield (_RING if self._has_ring(number) else _NOWHERE).format(f"end_{number}") + " }"

    # --- arrows -----------------------------------------------------------------------------------

    def _inner_arrows(self, number: int) -> Iterator[str]:
        """Yield the arrows from a container's start, and from its completing states to its end."""
        inside, begin, end = self.chart.inside(number), f"begin_{number}", f"end_{number}"
        if self.chart.states[number].kind.is_concurrent:
            # Invisible arrows place the states between the start and the end
            for inner in inside:
                yield f"{begin} -> {self._head(inner)} [style=invis];"
                yield f"{self._tail(inner)} -> {end} [style=invis];"
        elif inside:
            yield self._arrow(begin, self._head(inside[0]), self._cut(-1, inside[0]))
            for inner in inside:
                if self.chart.states[inner].completes:
                    yield self._arrow(self._tail(inner), end, self._cut(inner, -1))
            if not self._has_ring(number):
                yield f"{self._tail(inside[-1])} -> {end} [style=invis];"

    def _transition(self, place: int) -> str:
        """Return one arrow per transition: several lines in a label would read as one condition."""
        arrow = self.chart.arrows[place]
        looks, words = [f'id="arrow-{place}"'], [text(line) for line in arrow.symbol.splitlines()]
        if colour := _COLOURS.get(arrow.symbol.partition(" [")[0], ""):
            looks += [f'color="{colour}"', f'fontcolor="{colour}"', "style=dashed"]
        if likely := self.likely.get(place):
            words.append(f"<b>{likely}</b>")
            looks += [f'color="{_LIKELY}"', f'fontcolor="{_LIKELY}"', "penwidth=2"]
        if words:
            looks.append(f"label=<{'<br/>'.join(f'&#160;{line}&#160;' for line in words)}>")
        source, target = self._tail(arrow.source), self._head(arrow.target)
        if arrow.target > arrow.source:
            return self._arrow(source, target, [*looks, *self._cut(arrow.source, arrow.target)])
        cut_at = self._cut(arrow.target, arrow.source)  # the state declared first is above
        return self._arrow(target, source, [*looks, "dir=back", *cut_at])

    def _arrow(self, source: str, target: str, looks: list[str]) -> str:
        return f"{source} -> {target} [{', '.join(looks)}];"

    def _head(self, number: int) -> str:
        """Return the node where an arrow to a state ends; for a container, its start."""
        return f"{'begin_' if self._is_frame(number) else 's'}{number}"

    def _tail(self, number: int) -> str:
        """Return the node where an arrow from a state starts."""
        return f"{'end_' if self._is_frame(number) else 's'}{number}"

    def _cut(self, source: int, target: int) -> list[str]:
        """Return the attributes that cut an arrow at the frames of its ends.

        A frame that contains both ends does not cut the arrow. An arrow to a frame is longer, so
        that the head of the arrow is visible.
        """
        ends = (
            ("ltail=cluster_{}", source, target),
            ("lhead=cluster_{}, minlen=2", target, source),
        )
        return [
            look.format(number)
            for look, number, other in ends
            if number >= 0 and self._is_frame(number) and number not in self.chart.around(other)
        ]

    def _is_frame(self, number: int) -> bool:
        return self.chart.states[number].kind.is_container

    def _has_ring(self, number: int) -> bool:
        """Whether a container has a ring, since one of its states completes it."""
        is_concurrent = self.chart.states[number].kind.is_concurrent
        return not is_concurrent and any(
            self.chart.states[inner].completes for inner in self.chart.inside(number)
        )


def _label(state: ChartState, between: str) -> str:
    if state.kind in _SHAPES:
        return f'<font point-size="10">{text(state.label)}</font>'
    note = f' <font point-size="10" color="{FAINT}">{text(state.note)}</font>' if state.note else ""
    return between.join([f"<b>{text(state.label)}</b>{note}", *map(small, state.lines)])

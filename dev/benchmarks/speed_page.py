"""Write the figures and pictures of dev/records/speed.md from results of the benchmark.

python -m dev.benchmarks.speed_page [FILE [FOLDER]]    from dev/records/speed.json, in dev/records
"""

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from dev.benchmarks.messages.cases import ROBOT_BUS, TASK_PEERS
from dev.benchmarks.messages.results import Comparison, Report
from dev.benchmarks.messages.table import number, tables
from tca_tools.drawing.svg import document, rectangle, text, width_of

RECORDS = Path(__file__).parents[1] / "records"
BEGIN = "<!-- what follows is written by dev/benchmarks/speed_page.py -->"
SIZES = "round trip of "
LIBRARY = "central, module library"
PICTURES = {
    "speed-messages.svg": "Messages, as a part of what zmq.proxy does",
    "speed-images.svg": "Large data, as a part of what zmq.proxy does",
    "speed-tasks.svg": "Tracked tasks, as a part of what zmq.proxy does untracked",
}
_ROW, _BAR, _WIDTH, _MARGIN = 18.0, 12.0, 420.0, 14.0
_LEAST, _MOST = 1e-3, 20.0
"""The ends of the scale, as parts of the reference."""
_STYLE = ".ours { fill: #2f6fb2; } .other { fill: #b8c4d0; } .limit { fill: #52606d; }"


@dataclass(frozen=True)
class Aim:
    """A figure that was aimed at: a ratio to the table's reference or to the best rival, or a
    number.
    """

    case: str
    figure: float
    contestant: str = LIBRARY
    has_rivals: bool = False

    def row(self, table: Comparison) -> str | None:
        """Return the aim's line; None if it was not measured."""
        medians = {one.contestant: one.median for one in table.rows}
        rivals = [value for name, value in medians.items() if name in _RIVALS]
        own = next((one for one in table.rows if one.contestant == self.contestant), None)
        if own is None or (self.has_rivals and not rivals):
            return None
        is_less, to = table.is_less_better, f", to {table.reference}" if table.reference else ""
        reached = own.median if own.ratio is None else own.ratio
        if self.has_rivals:  # how many times as fast
            to, best = ", to the best other", min(rivals) if is_less else max(rivals)
            reached, is_less = best / own.median if is_less else own.median / best, False
        is_met = reached <= self.figure if is_less else reached >= self.figure
        aim = f"{'at most' if is_less else 'at least'} {self.figure:g}"
        met = "yes" if is_met else "**no**"
        return f"| {table.case}: {self.contestant}{to} | {aim} | {number(reached)} | {met} |"


_RIVALS = {entry.title for entry in (*TASK_PEERS, ROBOT_BUS)}
AIMS = (
    Aim("round trip", 1.7),
    Aim("100 open, one slot", 0.35),
    Aim("informs, one-way", 0.1),
    Aim("broadcast to 10", 0.08),
    Aim("commands, one by one", 4, has_rivals=True),
    Aim("commands, 100 open", 5, has_rivals=True),
    Aim("100 open, one slot", 0.85, "journal batch"),
    Aim("processor of the idle ones", 2, "500 idle modules"),
)


def page(report: Report) -> Iterator[str]:
    yield from (BEGIN, "", "## Figures", "")
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    machine = f"{report.machine['processors']} processors, Python {report.machine['python']}"
    rounds = f"{report.rounds} rounds of {report.seconds:g} s"
    yield f"{report.when[:10]}, {machine}; {rounds}. {versions}."
    for name, title in PICTURES.items():
        yield from ("", f"![{title}]({name})")
    yield from ("", "The scale of the pictures is logarithmic; longer is better.")
    rows = [aim.row(one) for aim in AIMS for one in report.tables if one.case == aim.case]
    yield from ("", "**Aims**", "", "| | aim | reached | |", "|---|---|---|---|")
    yield from filter(None, rows)
    for table in tables(report):
        unit = f" ({table.unit})" if table.unit else ""
        yield from ("", f"**{table.stage}: {table.case}**{unit}", "")
        for cells in (table.head, ["---"] * len(table.head), *table.rows):
            yield f"| {' | '.join(cells)} |"
    if report.missing:
        left_out = "; ".join(f"{name} ({why})" for name, why in report.missing.items())
        yield from ("", f"Left out: {left_out}.")


def drawn(report: Report, picture: str) -> list[Comparison]:
    """Return what a picture shows: cases with ratios, those with sizes among the large data."""
    stage = picture.removeprefix("speed-").removesuffix(".svg")
    return [
        one
        for one in report.tables
        if one.reference and stage == ("images" if one.case.startswith(SIZES) else one.stage)
    ]


def _place(part: float) -> float:
    """Return a part's place on the scale."""
    full = math.log10(_MOST / _LEAST)
    return max(math.log10(min(part, _MOST) / _LEAST) / full * _WIDTH, 1.0)


def picture(title: str, comparisons: list[Comparison]) -> str:
    """Draw bars on a logarithmic scale."""
    names = _MARGIN + max(
        (width_of(one.contestant) for table in comparisons for one in table.rows), default=0.0
    )
    body, top = [f'<text class="title" x="{_MARGIN}" y="22">{text(title)}</text>'], 60.0
    for part in (0.001, 0.01, 0.1, 1.0, 10.0):
        x = names + _MARGIN + _place(part)
        body.append(f'<text class="faint tick" x="{x:.0f}" y="46">{part:g}</text>')
    for table in comparisons:
        body.append(
            f'<text x="{_MARGIN}" y="{top + 6:.0f}" font-weight="bold">{text(table.case)}</text>'
        )
        top += _ROW
        for one in table.rows:
            if not one.ratio:
                continue
            part = 1 / one.ratio if table.is_less_better else one.ratio
            end = names + _MARGIN + _place(part)
            ours = one.contestant.startswith(("central", "module library"))
            style = "ours" if ours else "other"
            if one.contestant == table.reference:
                style = "limit"
            body.append(
                f'<text class="faint" x="{_MARGIN}" y="{top + 6:.0f}">{text(one.contestant)}</text>'
            )
            body.append(rectangle(f'class="{style}"', names + _MARGIN, top - 4, end, _BAR))
            body.append(
                f'<text class="faint" x="{end + 4:.0f}" y="{top + 6:.0f}">{number(part)}</text>'
            )
            top += _ROW
        top += 8
    return document(names + _WIDTH + 70, top + 4, title, _STYLE, body)


def write(results: Path, folder: Path) -> None:
    """Write the page and its pictures. The page's words, above the figures, stay."""
    report = msgspec.json.decode(results.read_bytes(), type=Report)
    for name, title in PICTURES.items():
        (folder / name).write_text(picture(title, drawn(report, name)))
    words = (RECORDS / "speed.md").read_text().partition(BEGIN)[0].rstrip()
    (folder / "speed.md").write_text("\n".join([words, "", *page(report), ""]))


if __name__ == "__main__":
    given = [Path(one) for one in sys.argv[1:]]
    write(*given, *(RECORDS / "speed.json", RECORDS)[len(given) :])

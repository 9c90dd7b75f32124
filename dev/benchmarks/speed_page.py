"""Write the figures and pictures of dev/records/speed.md, from results of the benchmark.

python -m dev.benchmarks.messages --peers --json FILE
python -m dev.benchmarks.speed_page FILE
"""

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec

from dev.benchmarks.messages.results import Comparison, Report, Standing
from dev.benchmarks.messages.table import number, ratio_range
from tca_tools.drawing.svg import document, rectangle, text, width_of

ROOT = Path(__file__).parents[2]
BEGIN = "<!-- what follows is written by dev/benchmarks/speed_page.py -->"
PICTURES = {
    "speed-messages.svg": ("Messages, as a part of what zmq.proxy does", "messages"),
    "speed-tasks.svg": ("Tracked tasks, as a part of what zmq.proxy does untracked", "tasks"),
}
SIZES = "round trip of "
_ROW, _BAR, _WIDTH, _MARGIN = 18.0, 12.0, 420.0, 14.0
_LEAST = 1e-3
"""The left end of the scale, as a part of the reference."""
_STYLE = ".ours { fill: #2f6fb2; } .other { fill: #b8c4d0; } .limit { fill: #52606d; }"


def page(report: Report) -> Iterator[str]:
    yield from (BEGIN, "", "## Figures", "")
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    machine = f"{report.machine['processors']} processors, Python {report.machine['python']}"
    rounds = f"{report.rounds} rounds of {report.seconds:g} s"
    yield f"{report.when[:10]}, {machine}; {rounds}. {versions}."
    for name, (title, _) in PICTURES.items():
        yield from ("", f"![{title}]({name})")
    yield from ("", "The scale of the pictures is logarithmic; longer is better.")
    for table in report.tables:
        yield from ("", f"**{table.stage}: {table.case}** ({table.unit})", "")
        yield f"| | to {table.reference} | of rounds | median | p99 | best | worst |".replace(
            "| to  |", "| |"
        )
        yield "|---|---|---|---|---|---|---|"
        yield from map(row, table.rows)
    if report.missing:
        left_out = "; ".join(f"{name} ({why})" for name, why in report.missing.items())
        yield from ("", f"Left out: {left_out}.")


def row(one: Standing) -> str:
    ratio = f"**{number(one.ratio)}**" if one.ratio is not None else ""
    figures = (
        number(value) if value is not None else ""
        for value in (one.median, one.p99, one.best, one.worst)
    )
    return f"| {one.contestant} | {ratio} | {ratio_range(one)} | {' | '.join(figures)} |"


def picture(title: str, tables: list[Comparison]) -> str:
    """Draw bars on a logarithmic scale, from a thousandth of the reference to its double."""
    names = max(width_of(one.contestant) for table in tables for one in table.rows) + _MARGIN
    full = math.log10(2 / _LEAST)
    body, top = [f'<text class="title" x="{_MARGIN}" y="22">{text(title)}</text>'], 34.0
    for part in (0.001, 0.01, 0.1, 1.0):
        x = names + _MARGIN + math.log10(part / _LEAST) / full * _WIDTH
        body.append(f'<text class="faint tick" x="{x:.0f}" y="46">{part:g}</text>')
    top += 26
    for table in tables:
        body.append(
            f'<text x="{_MARGIN}" y="{top + 6:.0f}" font-weight="bold">{text(table.case)}</text>'
        )
        top += _ROW
        for one in table.rows:
            if not one.ratio:
                continue
            part = 1 / one.ratio if table.is_less_better else one.ratio
            end = names + _MARGIN + max(math.log10(part / _LEAST) / full * _WIDTH, 1.0)
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


def main() -> None:
    report = msgspec.json.decode(Path(sys.argv[1]).read_bytes(), type=Report)
    for name, (title, stage) in PICTURES.items():
        tables = [
            table
            for table in report.tables
            if table.stage == stage and not table.case.startswith(SIZES)
        ]
        (ROOT / "dev/records" / name).write_text(picture(title, tables))
    words = (ROOT / "dev/records/speed.md").read_text().partition(BEGIN)[0].rstrip()
    (ROOT / "dev/records/speed.md").write_text("\n".join([words, "", *page(report), ""]))


if __name__ == "__main__":
    main()

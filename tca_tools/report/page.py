"""The page of a report: its contents as one HTML file that fetches nothing and runs no script."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from tca_tools.analysis.failures import Case
from tca_tools.analysis.long_waits import KINDS as HEADINGS
from tca_tools.gantt.legend import HATCHINGS
from tca_tools.gantt.looks import STYLE
from tca_tools.journal.fates import GOOD_FATES, HANDLED, Fate
from tca_tools.journal.records import TaskState
from tca_tools.report.contents import CASES, KINDS, Contents
from tca_tools.report.pictures import Gantt, Strip
from tca_tools.report.tree import DEEPEST, Tree, spans
from tca_tools.tasktree_viz import words
from tca_tools.terminal import cut
from tca_wire.text.measures import counted, duration, percent, run_time
from tca_wire.text.printable import first_line, printable

_HERE = Path(__file__).parent
_LONGEST_TEXT = 300
_LONGEST_SAID = 220
"""Characters of what was said of a failure that stand in the table."""


def page(
    name: str, damage: str, found: Contents, tree: Tree, gantt: Gantt | None, strips: list[Strip]
) -> str:
    """The report of journal *name*, which can't be read to its end if *damage* says so, as HTML."""
    run = found.summary
    verdict = "good" if run.is_good else "bad" if run.reasons else "open"
    now = f"{_clock(run.began, run.now)} ({run_time(run.now)})"
    style = Markup((_HERE / "page.css").read_text())  # noqa: S704 - a file of ours
    return (
        _environment()
        .get_template("page.html")
        .render(
            name=name,
            damage=damage,
            found=found,
            run=run,
            tree=tree,
            gantt=gantt,
            strips=strips,
            style=style,
            drawn=Markup,  # of what the pictures' makers have escaped
            verdict=verdict,
            began=_clock(run.began, run.start),
            now=now,
            fate_class=lambda fate: _FATES.get(fate, "good" if fate in GOOD_FATES else "bad"),
            kinds_of_waits=HEADINGS,
            longest_said=_LONGEST_SAID,
            kinds_shown=KINDS,
            cases_shown=CASES,
            whole_texts=_whole_texts,
            role=words.role,
            note=words.note,
            folded=words.folded,
            spans=spans,
            deepest=DEEPEST,
            chart_style=STYLE,
            hatchings=HATCHINGS,
        )
    )


def _whole_texts(cases: list[Case]) -> list[tuple[str, list[str]]]:
    """The whole texts of failures that the table cuts: whose they are, and their lines."""
    texts: dict[str, str] = {}
    for case in cases:
        if cut(first_line(case.text), _LONGEST_SAID) != case.text:
            texts.setdefault(case.text, case.of)
    return [(of, text.expandtabs(4).splitlines()) for text, of in texts.items()]


def _clock(began: float | None, time: float) -> str:
    """A time of the run on the wall clock, in UTC: a colleague may be anywhere."""
    if began is None:
        return "at a time that the journal does not tell"
    try:
        return f"{datetime.fromtimestamp(began + time, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):
        return "at a time that makes no sense"


_LOOKS = {HANDLED: "s-handled", TaskState.RESOLVED: "s-resolved"}
"""The classes of how tasks stand, where that is not their words."""


_FATES = {Fate.DEALT_WITH: "s-resolved"}


def _environment() -> Environment:
    """Everything that is put into the page is escaped, and has no characters that can't be seen."""
    made = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        finalize=_visible,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {
        "duration": duration,
        "run_time": run_time,
        "percent": percent,
        "counted": counted,
        "looks": lambda standing: _LOOKS.get(standing, f"s-{standing}"),
        "short": lambda text, width=_LONGEST_TEXT: cut(first_line(str(text)), width),
    }
    return made


def _visible(value: Any) -> Any:
    """Foreign text without control characters, and without those that turn the direction of
    writing.
    """
    return value if isinstance(value, Markup) else printable(str(value))

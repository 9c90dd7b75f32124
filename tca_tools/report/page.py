"""The page of a report: one HTML file that fetches nothing and runs no script."""

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
_LONGEST_FAILURE = 220
"""The most characters of a failure's text in the table."""


def page(
    name: str, damage: str, found: Contents, tree: Tree, gantt: Gantt | None, strips: list[Strip]
) -> str:
    """Return the report of a journal as HTML.

    Args:
        name: The journal's name.
        damage: Why a part of the journal could not be read; "" for none.
        found: The contents.
        tree: The task tree.
        gantt: The Gantt chart; None if no handler ran.
        strips: The use of resources over time.
    """
    run = found.summary
    verdict = "good" if run.is_good else "open"
    if run.reasons and not run.is_good:
        verdict = "bad"
    now = f"{_clock(run.began, run.now)} ({run_time(run.now)})"
    style = Markup((_HERE / "page.css").read_text())  # noqa: S704 - a file of this package
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
            drawn=Markup,  # pictures are already escaped
            verdict=verdict,
            began=_clock(run.began, run.start),
            now=now,
            fate_class=lambda fate: _FATE_STYLES.get(fate, "good" if fate in GOOD_FATES else "bad"),
            kinds_of_waits=HEADINGS,
            longest_failure=_LONGEST_FAILURE,
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
    """Return the texts of failures that the table cuts: the message, and the lines of the text."""
    texts: dict[str, str] = {}
    for case in cases:
        if cut(first_line(case.text), _LONGEST_FAILURE) != case.text:
            texts.setdefault(case.text, case.of)
    return [(message, text.expandtabs(4).splitlines()) for text, message in texts.items()]


def _clock(began: float | None, time: float) -> str:
    """Return a time of the run on the wall clock, in UTC for readers in all time zones."""
    if began is None:
        return "at an unknown time"
    try:
        return f"{datetime.fromtimestamp(began + time, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):
        return "at an impossible time"


_TASK_STYLES = {HANDLED: "s-handled", TaskState.RESOLVED: "s-resolved"}
"""By state of a task: its style, if that has another name."""


_FATE_STYLES = {Fate.DEALT_WITH: "s-resolved"}
"""By fate of a failure: its style, if that is neither "good" nor "bad"."""


def _environment() -> Environment:
    """Return the template environment, which escapes all values and removes control characters."""
    built = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        finalize=_visible,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    built.filters |= {
        "duration": duration,
        "run_time": run_time,
        "percent": percent,
        "counted": counted,
        "looks": lambda standing: _TASK_STYLES.get(standing, f"s-{standing}"),
        "short": lambda text, width=_LONGEST_TEXT: cut(first_line(str(text)), width),
    }
    return built


def _visible(value: Any) -> Any:
    """Return foreign text without control characters and changes of writing direction."""
    return value if isinstance(value, Markup) else printable(str(value))

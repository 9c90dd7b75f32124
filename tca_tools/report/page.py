"""The page of a report: its contents as one HTML file that fetches nothing and runs no script."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from tca_tools.analysis.failures import Kind
from tca_tools.analysis.long_waits import KINDS
from tca_tools.analysis.steps import Doing
from tca_tools.report.contents import Contents
from tca_tools.report.pictures import Gantt, Strip
from tca_tools.report.tree import Tree
from tca_tools.run.fates import GOOD_FATES, HANDLED
from tca_tools.terminal import cut
from tca_wire.text.measures import counted, duration, percent, run_time
from tca_wire.text.printable import first_line, printable

_HERE = Path(__file__).parent
_LONGEST_TEXT = 300
_LONGEST_SAID = 220
"""Characters of what was said of a failure that stand in the table."""


def page(name: str, damage: str, found: Contents, tree: Tree, gantt: Gantt | None, strips: list[Strip]) -> str:
    """The report of journal *name*, which can't be read to its end if *damage* says so, as HTML."""
    return (
        _environment()
        .get_template("page.html")
        .render(
            name=name,
            damage=damage,
            found=found,
            run=found.summary,
            tree=tree,
            gantt=gantt,
            drawn=Markup,  # of what the pictures' makers have escaped
            strips=strips,
            style=Markup((_HERE / "page.css").read_text()),  # noqa: S704 - a file of ours
            verdict=_verdict(found),
            began=_clock(found.summary.began, found.summary.start),
            now=f"{_clock(found.summary.began, found.summary.now)} ({run_time(found.summary.now)})",
            is_good_fate=lambda fate: fate in GOOD_FATES,
            doing=_DOING,
            kinds_of_waits=KINDS,
            longest_said=_LONGEST_SAID,
            shown_stories=lambda kind: _stories_of(kind, found),
            whole_texts=lambda kind: _texts_of(kind, found.cases_shown),
        )
    )


def _stories_of(kind: Kind, found: Contents) -> list[int]:
    """The failing messages of a kind whose stories are told."""
    return [number for number in dict.fromkeys(case.message_id for case in kind.cases) if number in found.stories]


def _texts_of(kind: Kind, cases: int) -> list[tuple[str, list[str]]]:
    """What was said of the failures that are shown, where the table shows only a part: of whom, and its lines."""
    texts: dict[str, str] = {}
    for case in kind.cases[:cases]:
        if cut(first_line(case.text), _LONGEST_SAID) != case.text:
            texts.setdefault(case.text, case.of)
    return [(of, [line.expandtabs(4) for line in text.splitlines()]) for text, of in texts.items()]


_DOING = {
    Doing.WORK: "work",
    Doing.OUTSIDE: "a program outside of any handler",
    Doing.DELAY: "a delay that was asked for",
    Doing.NO_HANDLER: "nobody handled it",
    Doing.QUEUED: "in a queue",
    Doing.LOCKED: "a lock",
    Doing.SUSPENDED: "suspended",
    Doing.KILLED: "until it was killed or its time was over",
    Doing.HELD: "held back",
    Doing.WATCHING: "a monitor watched",
    Doing.UNKNOWN: "the journal does not tell",
}


def _verdict(found: Contents) -> str:
    """``good``, ``bad`` or ``open``: the colour of the first line."""
    if found.summary.is_good:
        return "good"
    return "bad" if found.summary.reasons else "open"


def _clock(began: float | None, time: float) -> str:
    """A time of the run on the wall clock, in UTC: a colleague may be anywhere."""
    if began is None:
        return "at a time that the journal does not tell"
    try:
        return f"{datetime.fromtimestamp(began + time, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):
        return "at a time that makes no sense"


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
        "looks": lambda standing: "s-handled" if standing == HANDLED else f"s-{standing}",
        "short": lambda text, width=_LONGEST_TEXT: cut(first_line(str(text)), width),
    }
    return made


def _visible(value: Any) -> Any:
    """Foreign text without control characters, and without those that turn the direction of writing."""
    return value if isinstance(value, Markup) else printable(str(value))

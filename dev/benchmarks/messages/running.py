"""Rounds: in each, all contestants take turns in every case, so that what else the machine does
hits all.
"""

import contextlib
import importlib.util
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

from dev.benchmarks.messages.cases import Entrant, Needs, Stage, Trial
from dev.benchmarks.messages.driver import Broken, Driver, Figures
from dev.benchmarks.messages.processes import program_path

_WARM_UP = 0.2
"""Of the time of a measurement, before the first round."""


@dataclass
class Measured:
    """A case: the figures of each contestant, round by round."""

    stage: Stage
    case: Trial
    rows: dict[str, list[Figures]] = field(default_factory=dict)


@dataclass
class Results:
    """All that was measured, and who is missing why."""

    measured: list[Measured] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)


def lacking(needs: Needs) -> str:
    """What of it is not installed here; "" if all is."""
    packages = [f"package {name}" for name in needs.packages if not _is_importable(name)]
    programs = [f"program {name}" for name in needs.programs if program_path(name) is None]
    return ", ".join(packages + programs)


def _is_importable(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:  # not even the package that it would be in
        return False


def run(
    stages: Iterable[Stage], rounds: int, seconds: float, say: Callable[[str], None]
) -> Results:
    """Measure all, so many seconds each time. What can't take part is named."""
    result = Results()
    for stage in stages:
        entries = [entry for entry in stage.entries if _takes_part(entry, result, say)]
        measured = [Measured(stage, case) for case in stage.cases]
        say(f"{stage.title}: {', '.join(entry.title for entry in entries)}")
        groups = [[entry] for entry in entries] if stage.apart else [entries]
        for group in groups:
            with _started(group, result, say) as drivers:
                for number in range(rounds + 1):
                    say(
                        f"{stage.title}: round {number} of {rounds}"
                        if number
                        else f"{stage.title}: warming up"
                    )
                    for one in measured:
                        _measure(
                            one,
                            drivers,
                            seconds * (1 if number else _WARM_UP),
                            result,
                            say,
                            keep=number > 0,
                        )
        result.measured += measured
    return result


def _takes_part(entry: Entrant, result: Results, say: Callable[[str], None]) -> bool:
    if entry.title not in result.missing and (lack := lacking(entry.needs)):
        result.missing[entry.title] = f"{lack} not installed: {entry.needs.install}"
        say(f"{entry.title} is left out: {result.missing[entry.title]}")
    return entry.title not in result.missing


@contextlib.contextmanager
def _started(
    entries: list[Entrant], result: Results, say: Callable[[str], None]
) -> Iterator[list[Driver]]:
    drivers = [Driver(entry) for entry in entries]  # all begin at once
    try:
        for driver in drivers:
            _heeding(driver, driver.start, result, say)
        yield drivers
    finally:
        for driver in drivers:
            driver.stop()


def _measure(
    one: Measured,
    drivers: list[Driver],
    seconds: float,
    result: Results,
    say: Callable[[str], None],
    *,
    keep: bool,
) -> None:
    for driver in drivers:
        figures = _heeding(driver, partial(driver.measure, one.case, seconds), result, say)
        if figures and keep:
            one.rows.setdefault(driver.entry.title, []).append(figures)


def _heeding(
    driver: Driver, act: Callable[[], Figures | None], result: Results, say: Callable[[str], None]
) -> Figures | None:
    """What *act* returns; None if the contestant broke, now or before."""
    if driver.is_stopped:
        return None
    try:
        return act()
    except Broken as error:
        result.missing[driver.entry.title] = f"it broke: {error}"
        say(f"{driver.entry.title} is out: {error}")
        driver.stop()
        return None

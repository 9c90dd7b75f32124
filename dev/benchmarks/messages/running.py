"""Rounds: all contestants take turns in every case, so that other load affects all of them."""

import contextlib
import importlib.util
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

from dev.benchmarks.messages.cases import Entrant, Needs, Stage, Trial
from dev.benchmarks.messages.driver import Broken, Driver, Figures
from dev.benchmarks.messages.processes import program_path

_WARM_UP = 0.2
"""The part of a measurement's time for the warm-up before the first round."""


@dataclass
class Measured:
    """A case: the figures of each contestant, round by round."""

    stage: Stage
    case: Trial
    rows: dict[str, list[Figures]] = field(default_factory=dict)


@dataclass
class Results:
    """All measurements, and the missing contestants with the reason."""

    measured: list[Measured] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)


def lacking(needs: Needs) -> str:
    """Return the missing packages and programs; "" if all are installed."""
    packages = [f"package {name}" for name in needs.packages if not _is_importable(name)]
    programs = [f"program {name}" for name in needs.programs if program_path(name) is None]
    return ", ".join(packages + programs)


def _is_importable(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:  # its parent package is missing, too
        return False


def run(
    stages: Iterable[Stage], rounds: int, seconds: float, log: Callable[[str], None]
) -> Results:
    """Measure all cases, for *seconds* each time. It names contestants that can't take part."""
    result = Results()
    for stage in stages:
        entries = [entry for entry in stage.entries if _takes_part(entry, result, log)]
        measured = [Measured(stage, case) for case in stage.cases]
        log(f"{stage.title}: {', '.join(entry.title for entry in entries)}")
        groups = [[entry] for entry in entries] if stage.is_sequential else [entries]
        for group in groups:
            with _started(group, result, log) as drivers:
                for number in range(rounds + 1):
                    log(
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
                            log,
                            is_recorded=number > 0,
                        )
        result.measured += measured
    return result


def _takes_part(entry: Entrant, result: Results, log: Callable[[str], None]) -> bool:
    if entry.title not in result.missing and (lack := lacking(entry.needs)):
        result.missing[entry.title] = f"{lack} not installed: {entry.needs.install}"
        log(f"{entry.title} is left out: {result.missing[entry.title]}")
    return entry.title not in result.missing


@contextlib.contextmanager
def _started(
    entries: list[Entrant], result: Results, log: Callable[[str], None]
) -> Iterator[list[Driver]]:
    drivers = [Driver(entry) for entry in entries]  # all processes start at once
    try:
        for driver in drivers:
            _guarded(driver, driver.start, result, log)
        yield drivers
    finally:
        for driver in drivers:
            driver.stop()


def _measure(
    one: Measured,
    drivers: list[Driver],
    seconds: float,
    result: Results,
    log: Callable[[str], None],
    *,
    is_recorded: bool,
) -> None:
    for driver in drivers:
        figures = _guarded(driver, partial(driver.measure, one.case, seconds), result, log)
        if figures and is_recorded:
            one.rows.setdefault(driver.entry.title, []).append(figures)


def _guarded(
    driver: Driver, act: Callable[[], Figures | None], result: Results, log: Callable[[str], None]
) -> Figures | None:
    """Return the result of *act*; None if the contestant broke, now or before."""
    if driver.is_stopped:
        return None
    try:
        return act()
    except Broken as error:
        result.missing[driver.entry.title] = f"it broke: {error}"
        log(f"{driver.entry.title} is out: {error}")
        driver.stop()
        return None

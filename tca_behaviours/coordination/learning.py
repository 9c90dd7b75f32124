"""Likelihoods from earlier runs: how often each transition was taken, read from their journals."""

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from tca_tools.journal.journals import Log
from tca_wire.charts import MachineChart, read_machine
from tca_wire.coordination import CoordinationReport, read_report
from tca_wire.journal.facts import Entry, FormatDefined, Received, StateChanged


def count_transitions(
    journals: Iterable[Path | str | Iterable[Entry]], chart: MachineChart
) -> dict[tuple[str, str], int]:
    """Count how often each state of a machine was left by each symbol, for ``Learned``.

    Runs of other machines do not count, nor do transitions that this machine does not have.

    Args:
        journals: journals of earlier runs: their folders, their segments, or their entries.
        chart: the structure of the machine, such as ``Coordinator(machine).chart``.

    Returns:
        The counts by (label of the state, symbol of the transition).

    Example::

        counts = count_transitions(Path("journals").iterdir(), Coordinator(deliver).chart)
        here.to(there, likelihood=Learned(counts))
    """
    labels = {state.label for state in chart.states}
    symbols = {arrow.symbol for arrow in chart.arrows}
    counts: Counter[tuple[str, str]] = Counter()
    for journal in journals:
        entries = Log(Path(journal)) if isinstance(journal, Path | str) else journal
        for machine, report in _reports(entries):
            if (
                machine.name == chart.name
                and report.taken in symbols
                and 0 <= report.before < len(machine.states)
            ):
                label = machine.states[report.before].label
                if label in labels:
                    counts[label, report.taken] += 1
    return dict(counts)


def _reports(entries: Iterable[Entry]) -> Iterator[tuple[MachineChart, CoordinationReport]]:
    """Yield the reports of the coordinators in a journal, each with the chart of its machine."""
    formats: dict[str, str] = {}
    charts: dict[int, MachineChart] = {}
    for entry in entries:
        for fact in entry.facts:
            if isinstance(fact, FormatDefined):
                formats[fact.message] = fact.data
            elif isinstance(fact, Received):
                chart = read_machine(formats.get(fact.message, ""), fact.body)
                if chart is not None and chart.is_coordinated:
                    charts[fact.id] = chart
            elif (
                isinstance(fact, StateChanged)
                and fact.task in charts
                and (report := read_report(fact.body)) is not None
            ):
                yield charts[fact.task], report

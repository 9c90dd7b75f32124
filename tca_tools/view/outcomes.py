"""The outcomes of the runs that can be chosen, counted on request and cached.

A cached outcome is valid until the run's journal grows.
"""

from typing import Any

from tca_tools.errors import ToolError
from tca_tools.journal.journals import Log, open_log
from tca_tools.journal.outcomes import RunOutcome, outcome_of
from tca_tools.view.runs import Runs
from tca_wire.text.printable import printable_lines

_LONGEST = 64 << 20
"""Bytes: a larger journal is not counted, since this size already takes six seconds."""


class Outcomes:
    """The outcomes of runs, by their addresses."""

    def __init__(self, runs: Runs) -> None:
        self._runs = runs
        self._known: dict[str, tuple[int, RunOutcome, str]] = {}

    def of(self, address: str) -> dict[str, Any] | None:
        """Return the outcome of a run; None if there is no such run."""
        run = next((one for one in self._runs.all() if one.address == address), None)
        if run is None:
            return None
        try:
            log = open_log(run.path, run.epoch)
            size = sum(segment.stat().st_size for segment in log.segments())
            if size > _LONGEST:
                return {"error": f"{size / (1 << 20):,.0f} MiB, not counted: open it"}
            known = self._known.get(address)
            if known is None or known[0] != size:
                found = outcome_of(log)
                known = self._known[address] = size, found, "damaged" if log.is_cut_short else ""
        except ToolError as error:
            return {"error": printable_lines(error.message)}
        except OSError as error:
            which = error.filename or run.path
            return {"error": printable_lines(f"{which}: can't be read: {error.strerror}")}
        _, outcome, damage = known
        return {
            "state": damage or _state(log, outcome),
            "lasted": outcome.lasted,
            "tasks": outcome.tasks,
            "top": list(outcome.top.items()),
            "why": printable_lines(outcome.why),
        }


def _state(log: Log, outcome: RunOutcome) -> str:
    if outcome.is_closed:
        return "ended"
    return "live" if log.is_being_written else "not closed"

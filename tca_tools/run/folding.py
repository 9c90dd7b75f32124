"""A journal folded into what was known at a moment of it, or is by now: all tools that show a whole run ask here."""

from collections.abc import Iterable

from tca_tools.run.fold import History
from tca_tools.run.journals import Log
from tca_wire.journal.facts import Entry


def folded(journal: Log, time: float | None = None, entries: Iterable[Entry] | None = None) -> History:
    """What was known at *time* (seconds on the run's clock; None: at the end, and of a run that goes on, now).

    *entries* are those of the journal, if somebody wants to see them on the way. Raises UnusableLog if there are none.
    """
    history = History.until(journal if entries is None else entries, time)
    history.go_on(journal.present(history.time), time)
    return history

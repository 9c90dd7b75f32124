"""Warns of losses, which may come in floods: one line a second per kind, with the count."""

import logging
from math import inf
from typing import Any

from tca_wire.journal import facts
from tca_wire.vocabulary import Dropping, Refusal

PERIOD = 1.0
"""Seconds between two lines about one kind of loss."""


def loss_in(fact: Any) -> tuple[str, str] | None:
    """Return the kind and reason of the loss that a fact reports; None if it reports none."""
    match fact:
        case facts.Dropped(dropping=Dropping.OVERLOAD):
            return f"dropped '{fact.message}'", fact.why
        case facts.RequestRefused(refusal=Refusal.OVERLOAD):
            return f"refused module '{fact.sender}'", fact.text
    return None


class LossLog:
    """Collects losses. It has no clock: call ``write_due`` about once per period."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        #: By kind of loss: the time of its last line, the losses since then, and their reason.
        self._lines: dict[str, tuple[float, int, str]] = {}

    def count(self, kind: str, why: str, now: float) -> None:
        """Count a loss; log it unless its kind was logged within the period."""
        logged_at, earlier, _ = self._lines.get(kind, (-inf, 0, ""))
        self._lines[kind] = logged_at, earlier + 1, why
        if now - logged_at >= PERIOD:
            self._write(kind, now)

    def write_due(self, now: float = inf) -> None:
        """Log the kinds whose period is over, and forget those without new losses."""
        for kind, (logged_at, number, _) in list(self._lines.items()):
            if now - logged_at >= PERIOD:
                if number:
                    self._write(kind, now)
                else:
                    del self._lines[kind]

    def _write(self, kind: str, now: float) -> None:
        _, number, why = self._lines[kind]
        self._log.warning("%s%s: %s", kind, f" {number:,} times" if number > 1 else "", why)
        self._lines[kind] = now, 0, why

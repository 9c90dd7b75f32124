"""Lines of the log: failures, refusals, losses, modules that join and leave, blind monitors."""

import logging
from collections.abc import Callable
from typing import Any

from tca_central.core import Central
from tca_central.events import Record
from tca_central.shell.loss_log import LossLog, loss_in
from tca_wire.journal import facts
from tca_wire.messages.failures import misspelt
from tca_wire.text.nearest import nearest
from tca_wire.text.printable import first_line, printable, shortened

NAMED = 3
"""The number of failed tasks and messages that a line names for one cause."""

OFTEN = 20
"""Attempts after which the log warns once of a task."""
_MOST_OFTEN = 1000
"""Tasks of which the log remembers that it has warned."""

LONGEST_LINE = 2000
"""Characters of a line. The journal has the full text."""


class LineFormatter(logging.Formatter):
    """Formats a record as one line, whatever its texts contain; a traceback has more lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging calls it so
        """Return the line, with escapes for characters that would control a terminal."""
        return shortened(
            printable(shortened(super().formatMessage(record), LONGEST_LINE)), LONGEST_LINE
        )

    def formatException(self, ei: Any) -> str:  # noqa: N802 - logging calls it so
        """Return the lines of a traceback, with escapes like the line."""
        return "\n".join(
            shortened(printable(line), LONGEST_LINE)
            for line in super().formatException(ei).splitlines()
        )


class LogLines:
    """Writes a log line for each fact that users must know of."""

    def __init__(
        self,
        log: logging.Logger,
        central: Central,
        end: Callable[[facts.CentralEnding], object] = lambda _: None,
    ) -> None:
        self.losses = LossLog(log)
        self._log = log
        self._central = central
        #: Tasks whose frequent retries were logged.
        self._often: set[int] = set()
        #: Conditions without a handler that were logged.
        self._unhandled: set[str] = set()
        self._writers: dict[type, Callable[[Any, Record], object]] = {
            facts.Dropped: self._count_loss,
            facts.RequestRefused: self._refused,
            facts.Ignored: lambda fact, _: log.warning(
                "nothing done for module '%s': %s", fact.sender, fact.text
            ),
            facts.ModuleJoined: self._joined,
            facts.KeysChanged: self._keys,
            facts.PermissionsChanged: self._permissions,
            facts.ModuleLeft: lambda fact, _: log.info(
                "module '%s' left: %s", fact.module, fact.why
            ),
            facts.Attached: self._attached,
            facts.Unhandled: self._unhandled_failure,
            facts.CentralEnding: lambda fact, _: end(fact),
            facts.Queued: self._queued,
            facts.Retried: self._retried,
            facts.HandlerAdded: lambda fact, _: self._unhandled.discard(fact.message),
        }

    def write(self, record: Record) -> None:
        """Log what the facts of a record report."""
        writers = self._writers
        for fact in record.entry.facts:
            if type(fact) in writers:
                writers[type(fact)](fact, record)
        if record.failed:
            self._failed(record)

    def _joined(self, fact: facts.ModuleJoined, _: Record) -> None:
        owner = f", {fact.principal}" if fact.principal else ""
        self._log.info("module '%s' joined (%s%s)", fact.module, fact.process, owner)

    def _keys(self, fact: facts.KeysChanged, _: Record) -> None:
        for what, names in (("allowed", fact.allowed), ("revoked", fact.revoked)):
            if names:
                self._log.info("%s: %s", what, ", ".join(names))

    def _permissions(self, fact: facts.PermissionsChanged, _: Record) -> None:
        if fact.rules < 0:
            self._log.info("no permissions file: every program that connects may do everything")
        else:
            self._log.info("permissions from %s (%d rules)", fact.source, fact.rules)

    def _count_loss(self, fact: facts.Fact, record: Record) -> bool:
        """Count the loss that a fact reports. Return whether it reports one."""
        if (loss := loss_in(fact)) is None:
            return False
        self.losses.count(*loss, record.entry.time)
        return True

    def _refused(self, fact: facts.RequestRefused, record: Record) -> None:
        if not self._count_loss(fact, record):
            self._log.warning("refused module '%s': %s", fact.sender, fact.text)

    def _failed(self, record: Record) -> None:
        """Log each cause once: the loss of a module may fail many messages."""
        causes: dict[tuple[str, str], list[str]] = {}
        for fact in record.entry.facts:
            if isinstance(fact, facts.Failed):
                causes.setdefault((fact.failure, fact.text), []).append(record.failed[fact.id])
        for (failure, text), parts in causes.items():
            named, reason = ", ".join(parts[:NAMED]), first_line(text)
            more = f" and {len(parts) - NAMED:,} more" if len(parts) > NAMED else ""
            self._log.warning(
                "failure '%s' of %s%s%s", failure, named, more, f": {reason}" if reason else ""
            )

    def _attached(self, fact: facts.Attached, _: Record) -> None:
        """Warn of an exception handler that nothing calls: its failure has a name of its own."""
        if meant := misspelt(fact.failure):
            text = "exception handler '%s' is attached to failure '%s': did you mean '%s'?"
            self._log.warning(text, fact.handler, fact.failure, meant)

    def _unhandled_failure(self, fact: facts.Unhandled, record: Record) -> None:
        """Warn of exception handlers that no module handles, or for a similar name."""
        found = (one for one in record.entry.facts if isinstance(one, facts.Failed))
        name = next((one.failure for one in found if one.id == fact.task), "")
        attached = self._central.attached.values()
        known = {one.failure for one in attached}
        fitting = {one.handler for one in attached if one.failure in ("", name)}
        if idle := sorted(one.name for one in fitting if not one.handlers):
            text = "no module handles exception handler '%s', which is attached to failure '%s'"
            self._log.warning(text, "', '".join(idle[:NAMED]), name)
        if name not in known and (similar := nearest(name, known)):
            text = "failure '%s' has no exception handler, but '%s' has one: do both mean the same?"
            self._log.warning(text, name, similar)

    def _retried(self, fact: facts.Retried, _: Record) -> None:
        """Warn once of a task that is retried often."""
        task = self._central.tree.tasks.get(fact.task)
        attempts = task.recovery.attempts if task is not None and task.recovery is not None else 0
        if attempts >= OFTEN and fact.task not in self._often:
            if len(self._often) >= _MOST_OFTEN:
                self._often.clear()
            self._often.add(fact.task)
            self._log.warning("%s has been handled %d times, and is retried again", task, attempts)

    def _queued(self, fact: facts.Queued, _: Record) -> None:
        """Warn once of a monitor's condition that no module handles."""
        if fact.module or (watch := self._central.watch_of_condition.get(fact.id)) is None:
            return
        condition = watch.condition.message.name if watch.condition is not None else ""
        if condition not in self._unhandled:
            self._unhandled.add(condition)
            self._log.warning(
                "%s sees nothing until a module handles its condition '%s'", watch.task, condition
            )

"""A journal held against the rules of task-level control and against properties, in one pass."""

from collections.abc import Callable, Iterable
from functools import partial

from tca_tools.check.checker import Checker
from tca_tools.check.judge import Judge
from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import RULES, Violation
from tca_tools.check.world import JournalWorld
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log
from tca_tools.properties import BadProperty, Property
from tca_tools.properties.field_values import FieldValue
from tca_tools.properties.predicates import OfMessages
from tca_wire.text.nearest import did_you_mean


class CheckedRun(Checker):
    """A journal on its way past the rules and properties, and what came of it.

    Properties that look at all records of the run, as those of cases do, need a *history*, which is filled meanwhile.
    """

    def __init__(self, wanted: Iterable[Property], history: History | None = None) -> None:
        super().__init__(history)
        self.judges = [Judge(one) for one in wanted]
        self.messages: dict[str, None] = {}
        self.modules: dict[str, None] = {}
        self.unbroken = list(self.judges)
        self._touched: dict[MessageRecord, None] = {}

    @classmethod
    def of(cls, journal: Log, wanted: Iterable[Property], history: History | None = None) -> "CheckedRun":
        """The whole of a journal, checked. Raises BadProperty if a property can't be asked."""
        run, losses = cls(wanted, history), journal.losses
        lost = unknown = 0
        for entry in journal:
            if losses.places > lost:
                run.skip(losses.places - lost)
            if losses.facts > unknown:
                run.leave_out(entry)
            else:
                run.take(entry)
            lost, unknown = losses.places, losses.facts
        if losses.places > lost:
            run.skip(losses.places - lost)
        if journal.is_cut_short:
            run.skip(1)
        run.close()
        return run

    @property
    def rules_kept(self) -> int:
        """How many of ``RULES`` are kept."""
        return len(RULES) - len({violation.rule for violation in self.violations if violation.source})

    def _follow(self, world: JournalWorld) -> None:
        """An event is over: ask the properties about what changed, with it or (what is so for one event) before it."""
        if not self.judges:
            return
        changed = self._touched | world.touched
        self._touched = world.touched.copy()
        for item in world.touched:
            if item.is_new:
                self.messages[item.message] = None
        for module in world.joined if world.joined.keys() - self.modules.keys() else ():
            self.modules[module] = None
        for judge in list(self.unbroken):
            self._ask(judge, partial(judge.after, world, changed), world.events)

    def _ask(self, judge: Judge, ask: Callable[[], str], place: int) -> None:
        """Ask for what is wrong with a property after the event at a place, and note it."""
        try:
            wrong = ask()
        except Exception as error:  # a mistake in it, not in the robot
            raise BadProperty(f"property '{judge.stated}' can't be asked: {type(error).__name__}: {error}") from error
        if wrong:
            self.unbroken.remove(judge)
            words, world = str(judge.stated), self.world
            self.violations.append(Violation(words, "", place, world.event, world.now, judge.culprit, wrong))

    def close(self) -> None:
        """The journal is read, or nothing more of it can be."""
        super().close()
        for judge in list(self.unbroken):
            self._ask(judge, partial(judge.at_end, self.world), max(self.world.events - 1, 0))

    def misnamed(self) -> dict[Property, str]:
        """The properties of what the journal does not know, or does not allow: they would hold whatever happens."""
        world = self.world
        messages = self.messages.keys() | world.declared.keys()
        found = {}
        for judge in self.judges:
            for one in judge.stated.predicates:
                if isinstance(one, OfMessages) and one.is_typed:
                    misfit = "" if judge.matches.has_subject(one) else _misfit(one, world)
                    unknown = _unknown("message", one.message, messages) or _unknown("module", one.module, self.modules)
                    if wrong := unknown or misfit:
                        found[judge.stated] = wrong
        return found


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    if not name or name in known:
        return ""
    return f"the journal has no {kind} '{name}'{did_you_mean(name, known, ': ')}"


def _misfit(predicate: OfMessages, world: JournalWorld) -> str:
    """Of a message that never came, its declaration must allow that it might have."""
    name = predicate.message
    formats = [one.data for one in world.declared.values() if name in ("", one.message)]
    values = [one for one in predicate.data if isinstance(one, FieldValue)] if formats else []
    wrong = next(filter(None, (one.misfit(formats) for one in values)), "")
    return f"of '{name}', {wrong}" if wrong and name else wrong

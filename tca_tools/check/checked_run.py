"""A journal held against the rules of task-level control and against properties, in one pass."""

from collections.abc import Iterable

from tca_tools.check.checker import Checker
from tca_tools.check.judge import Judge
from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import RULES, Violation
from tca_tools.check.world import JournalWorld
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log
from tca_tools.journal.losses import Losses
from tca_tools.journal.selection import nearest_to
from tca_tools.properties import BadProperty, Property
from tca_tools.properties.field_values import FieldValue
from tca_tools.properties.predicates import OfMessages
from tca_wire.journal.facts import Entry


class CheckedRun:
    """A journal on its way past the rules and properties, and what came of it.

    Properties that look at all records of the run, as those of cases do, need a *history*, which is filled meanwhile.
    """

    def __init__(self, wanted: Iterable[Property], history: History | None = None) -> None:
        self.judges = [Judge(one) for one in wanted]
        self.checker = Checker(self._follow if self.judges else lambda _: None)
        self.violations = self.checker.violations
        self.checker.history = history
        self.messages: dict[str, None] = {}
        self.modules: dict[str, None] = {}
        self.unbroken = list(self.judges)
        self._touched: dict[MessageRecord, None] = {}
        self._lost = self._unknown = 0

    @classmethod
    def of(cls, journal: Log, wanted: Iterable[Property], history: History | None = None) -> "CheckedRun":
        """The whole of a journal, checked. Raises BadProperty if a property can't be asked."""
        run = cls(wanted, history)
        for entry in journal:
            run.take(entry, journal.losses)
        run.close(journal.losses, is_cut_short=journal.is_cut_short)
        return run

    @property
    def is_whole(self) -> bool:
        """Whether all of the run could be read: else what is not broken is not known to hold."""
        return not self.checker.gaps

    @property
    def rules_kept(self) -> int:
        """How many of ``RULES`` are kept."""
        return len(RULES) - len({violation.rule for violation in self.violations if violation.source})

    def take(self, entry: Entry, losses: Losses) -> None:
        """The next entry, and what was passed over until then, with it or before it."""
        self._pass_over(losses)
        if losses.facts > self._unknown:
            self._unknown = losses.facts
            self.checker.leave_out(entry)
        else:
            self.checker.take(entry)

    def _pass_over(self, losses: Losses) -> None:
        if losses.places > self._lost:
            self.checker.skip(losses.places - self._lost)
            self._lost = losses.places

    def _follow(self, world: JournalWorld) -> None:
        """An event is over: ask the properties about what changed, with it or (what is so for one event) before it."""
        changed = self._touched | world.touched
        self._touched = world.touched.copy()
        for item in world.touched:
            if item.is_new:
                self.messages[item.message] = None
        for module in world.joined if world.joined.keys() - self.modules.keys() else ():
            self.modules[module] = None
        for judge in list(self.unbroken):
            try:
                wrong = judge.after(world, changed)
            except Exception as error:  # a mistake in it, not in the robot
                raise _unaskable(judge, error) from error
            self._judge(judge, wrong, world, world.events)

    def _judge(self, judge: Judge, wrong: str, world: JournalWorld, place: int) -> None:
        if wrong:
            self.unbroken.remove(judge)
            words = str(judge.stated)
            self.violations.append(Violation(words, "", place, world.event, world.now, judge.culprit, wrong))

    def close(self, losses: Losses, *, is_cut_short: bool) -> None:
        """The journal is read, or nothing more of it can be (*is_cut_short*)."""
        self._pass_over(losses)
        if is_cut_short:
            self.checker.skip(1)
        self.checker.close()
        world = self.checker.world
        for judge in list(self.unbroken):
            try:
                wrong = judge.at_end(world)
            except Exception as error:  # a mistake in it, not in the robot
                raise _unaskable(judge, error) from error
            self._judge(judge, wrong, world, max(world.events - 1, 0))

    def misnamed(self) -> dict[Property, str]:
        """The properties of what the journal does not know, or does not allow: they would hold whatever happens."""
        world = self.checker.world
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


def _unaskable(judge: Judge, error: Exception) -> BadProperty:
    return BadProperty(f"property '{judge.stated}' can't be asked: {type(error).__name__}: {error}")


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    if not name or name in known:
        return ""
    return f"the journal has no {kind} '{name}'{nearest_to(name, known)}"


def _misfit(predicate: OfMessages, world: JournalWorld) -> str:
    """Of a message that never came, its declaration must allow that it might have."""
    name = predicate.message
    formats = [one.data for one in world.declared.values() if name in ("", one.message)]
    values = [one for one in predicate.data if isinstance(one, FieldValue)] if formats else []
    wrong = next(filter(None, (one.misfit(formats) for one in values)), "")
    return f"of '{name}', {wrong}" if wrong and name else wrong

"""A journal held against the rules of task-level control and against properties, in one pass at a
bounded cost for each fact.
"""

from collections.abc import Callable, Iterable
from functools import partial

from tca_tools.check import presence
from tca_tools.check.events import end_event, take_fact
from tca_tools.check.judge import Judge
from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import CLOCK, RULES, Violation
from tca_tools.check.world import JournalWorld
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log
from tca_tools.properties import BadProperty, Property
from tca_tools.properties.field_values import FieldValue
from tca_tools.properties.predicates import OfMessages
from tca_wire.journal import facts
from tca_wire.text.nearest import did_you_mean


class CheckedRun:
    """A journal on its way past the rules and properties, and what came of it. Give it every entry,
    then ``close`` it.

    Properties that look at all records of the run, as those of cases do, need a *history*, which is
    filled meanwhile.
    """

    def __init__(self, wanted: Iterable[Property] = (), history: History | None = None) -> None:
        self.judges = [Judge(one) for one in wanted]
        self.unbroken = list(self.judges)
        self.messages: set[str] = set()
        self.modules: set[str] = set()
        self._touched: dict[MessageRecord, None] = {}
        self.violations: list[Violation] = []
        self.world = JournalWorld(self.violations, is_whole=False)
        self.history = history  #: is folded along, for properties that ask for all records
        self.events = 0
        self.facts = 0
        self.gaps: list[str] = []  #: the missing parts, in words
        self.is_closed = False  #: central ended of its own will
        self._is_open = False  #: an event is being folded
        self._epoch, self._segment = "", 0
        self._may_have_missed_opening = False
        self.began = 0.0
        self._shortened = -1.0  #: what had ended by then was removed
        self.first = self.last = 0  #: numbers of entries

    @classmethod
    def of(
        cls, journal: Log, wanted: Iterable[Property], history: History | None = None
    ) -> "CheckedRun":
        """The whole of a journal, checked. Raises BadProperty if a property can't be asked."""
        run, losses = cls(wanted, history), journal.losses
        lost = unknown = 0
        for entry in journal:
            run.skip(losses.places - lost)
            if losses.facts > unknown:
                run.pass_over(
                    entry,
                    f"at {entry.time:.2f} s something happened that this version does not know",
                )
            else:
                run.take(entry)
            lost, unknown = losses.places, losses.facts
        run.skip(losses.places - lost)
        run.skip(int(journal.is_cut_short))
        run.close()
        return run

    @property
    def rules_kept(self) -> int:
        """How many of ``RULES`` are kept."""
        return len(RULES) - len(
            {violation.rule for violation in self.violations if violation.source}
        )

    @property
    def is_whole(self) -> bool:
        """Whether all of the run could be read: else what is not broken is not known to hold."""
        return not self.gaps

    def take(self, entry: facts.Entry) -> None:
        """The next entry. Several of one number are one event."""
        if self._is_shortened(entry):
            self.pass_over(entry, "")
            return
        if not (self._is_open and entry.number == self.world.event):
            self._end_event()
            self._begin_event(entry)
        if self.history is not None:
            self.history.apply(entry)
        self.facts += len(entry.facts)
        for fact in entry.facts:
            if type(fact) is facts.Opened:
                self._opened(fact, entry)
            elif type(fact) is facts.Closed:
                if self.is_closed:
                    self.world.broken(CLOCK, 0, "central ended a second time")
                self.is_closed = True
            else:
                take_fact(self.world, fact)

    def _is_shortened(self, entry: facts.Entry) -> bool:
        """Whether facts may have been removed that belong to an entry."""
        for fact in entry.facts[1:2]:
            if isinstance(fact, facts.Shortened):
                self._shortened = fact.until
                self.gaps.append(
                    f"what had ended by {fact.until:.2f} s was removed: only what came later is judged"
                )
        return entry.time <= self._shortened

    def skip(self, places: int) -> None:
        """Before the next entry there were so many places that can't be read: nothing is claimed of
        what was sent before.
        """
        if not places:
            return
        self._end_event()
        which = f"{places} entries or more" if places > 1 else "an entry, or more,"
        self._begin_anew(f"after {self.world.now:.2f} s {which} can't be read")

    def pass_over(self, entry: facts.Entry, why: str) -> None:
        """The next entry, of which nothing is claimed, nor of what was sent before."""
        is_same = self._is_open and entry.number == self.world.event
        self._end_event()
        if self.history is not None:
            self.history.apply(entry)
        self._note(entry)
        for fact in entry.facts:
            if isinstance(fact, facts.Opened):
                self._epoch, self._segment = fact.epoch, fact.segment
            elif isinstance(fact, facts.FormatDefined):
                presence.format_defined(self.world, fact)
        self.is_closed = any(isinstance(fact, facts.Closed) for fact in entry.facts)
        self.facts += len(entry.facts)
        self.events += not is_same
        self._begin_anew(why)
        self.world.events += not is_same
        self.world.now = entry.time

    def _begin_anew(self, why: str) -> None:
        """Forget what is under way, and keep what has been declared."""
        known = self.world
        if why:
            self.gaps.append(f"{why}: what was under way then is not known")
        self.world = JournalWorld(self.violations, is_whole=False, events=known.events)
        self.world.now, self.world.declared = known.now, known.declared
        self.world.cycles, self.world.accepting = known.cycles, known.accepting
        self._may_have_missed_opening = True

    def _begin_event(self, entry: facts.Entry) -> None:
        world = self.world
        self._note(entry)
        if not self.events:
            if not (
                self._may_have_missed_opening
                or (entry.facts and isinstance(entry.facts[0], facts.Opened))
            ):
                self.gaps.append(
                    "it begins in the middle of a segment: what was sent before is not known"
                )
        elif not isinstance(entry.facts[0] if entry.facts else None, facts.Opened):
            self._check_clock(entry)
        world.forget()
        world.begin(entry)
        self._is_open = True
        self.events += 1

    def _note(self, entry: facts.Entry) -> None:
        """Note where the journal begins, and how far it goes."""
        if not self.events:
            self.began, self.first = entry.time, entry.number
        self.last = entry.number

    def _check_clock(self, entry: facts.Entry) -> None:
        world = self.world
        if entry.time < world.now or entry.number < world.event:
            before, after = (
                f"entry {world.event} at {world.now:g} s",
                f"entry {entry.number} at {entry.time:g} s",
            )
            world.broken(CLOCK, 0, f"{after} comes after {before}")
        elif self.is_closed:
            world.broken(CLOCK, 0, f"entry {entry.number} comes after central ended")

    def _end_event(self) -> None:
        if not self._is_open:
            return
        self._is_open = False
        world = self.world
        end_event(world)
        world.history = self.history
        self._follow(world)
        world.events += 1

    def _opened(self, fact: facts.Opened, entry: facts.Entry) -> None:
        """A segment begins: of this run, of another one, or after some that are missing."""
        is_other = fact.epoch != self._epoch
        is_next = fact.segment == self._segment + 1
        if is_other or not is_next:
            if is_other and self._epoch:
                self.gaps.append(f"at {entry.time:.2f} s another run begins ({fact.epoch})")
            if (not is_other or fact.segment != 1) and not self._may_have_missed_opening:
                missing = fact.segment - 1 - (0 if is_other else self._segment)
                which = f"{missing} segment{'s' * (missing != 1)} before segment {fact.segment}"
                self.gaps.append(
                    f"missing: {which}; what was sent before {entry.time:.2f} s is not known"
                )
            is_first = is_other and fact.segment == 1
            self.world = JournalWorld(self.violations, is_whole=is_first, events=self.world.events)
            self.world.begin(entry)
        self._epoch, self._segment, self.is_closed = fact.epoch, fact.segment, False
        self._may_have_missed_opening = False

    # --- properties -------------------------------------------------------------------------------

    def _follow(self, world: JournalWorld) -> None:
        """An event is over: ask the properties about what changed, with it or (what is so for one
        event) before it.
        """
        if not self.judges:
            return
        changed = self._touched | world.touched
        self._touched = world.touched.copy()
        self.messages.update(item.message for item in world.touched if item.is_new)
        self.modules.update(world.joined)
        for judge in list(self.unbroken):
            self._ask(judge, partial(judge.after, world, changed), world.events)

    def _ask(self, judge: Judge, ask: Callable[[], str], place: int) -> None:
        """Ask for what is wrong with a property after the event at a place, and note it."""
        try:
            wrong = ask()
        except Exception as error:  # a mistake in it, not in the robot
            raise BadProperty(
                f"property '{judge.stated}' can't be asked: {type(error).__name__}: {error}"
            ) from error
        if wrong:
            self.unbroken.remove(judge)
            words, world = str(judge.stated), self.world
            self.violations.append(
                Violation(words, "", place, world.event, world.now, judge.culprit, wrong)
            )

    def close(self) -> None:
        """The journal is read, or nothing more of it can be."""
        self._end_event()
        for judge in list(self.unbroken):
            self._ask(judge, partial(judge.at_end, self.world), max(self.world.events - 1, 0))

    def misnamed(self) -> dict[Property, str]:
        """The properties of what the journal does not know, or does not allow: they would hold
        whatever happens.
        """
        world = self.world
        messages = self.messages | world.declared.keys()
        found = {}
        for judge in self.judges:
            for one in judge.stated.predicates:
                if isinstance(one, OfMessages) and one.is_typed:
                    misfit = "" if judge.matches.has_subject(one) else _misfit(one, world)
                    unknown = _unknown("message", one.message, messages) or _unknown(
                        "module", one.module, self.modules
                    )
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

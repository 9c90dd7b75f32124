"""Check a journal against the rules and properties, in one pass and at O(1) for each fact."""

from collections.abc import Callable, Iterable
from functools import partial

from tca_tools.check import presence
from tca_tools.check.events import apply_fact, finish_event
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
    """The check of one journal: pass every entry to ``apply``, then call ``close``.

    Args:
        wanted: The properties to check beside the rules.
        history: Records to fill along the way. Properties that read all records of the run, such as
            those of cases, need them.
    """

    def __init__(self, wanted: Iterable[Property] = (), history: History | None = None) -> None:
        self.judges = [Judge(one) for one in wanted]
        self.unbroken = list(self.judges)  #: the judges of properties that hold so far
        self.messages: set[str] = set()  #: the names of all messages so far
        self.modules: set[str] = set()  #: the names of all modules so far
        #: The messages that the event before the current one changed.
        self._changed_before: dict[MessageRecord, None] = {}
        self.violations: list[Violation] = []
        self.world = JournalWorld(self.violations, is_whole=False)
        self.history = history  #: filled along, for properties that read all records
        self.events = 0
        self.facts = 0
        self.gaps: list[str] = []  #: the missing parts, in words
        self.is_closed = False  #: central has closed the run
        self._is_in_event = False  #: an event is being checked
        self._epoch, self._segment = "", 0
        #: Whether the start of a segment may be in a part that can't be read.
        self._may_have_missed_opening = False
        self.began = 0.0
        self._shortened = -1.0  #: the time until which ended records were removed
        self.first = self.last = 0  #: the numbers of the first and last entry

    @classmethod
    def of(
        cls, journal: Log, wanted: Iterable[Property], history: History | None = None
    ) -> "CheckedRun":
        """Check a whole journal.

        Args:
            journal: The journal.
            wanted: The properties to check beside the rules.
            history: Records to fill along the way, for properties that read them.

        Raises:
            BadProperty: A property raised an error.
        """
        run, losses = cls(wanted, history), journal.losses
        lost = unknown = 0
        for entry in journal:
            run.skip_places(losses.places - lost)
            if losses.facts > unknown:
                what = "there is a fact that this version does not know"
                run.skip_entry(entry, f"at {entry.time:.2f} s {what}")
            else:
                run.apply(entry)
            lost, unknown = losses.places, losses.facts
        run.skip_places(losses.places - lost)
        run.skip_places(int(journal.is_cut_short))
        run.close()
        return run

    @property
    def rules_kept(self) -> int:
        """The number of ``RULES`` that are kept."""
        broken = {violation.rule for violation in self.violations if violation.source}
        return len(RULES) - len(broken)

    @property
    def is_whole(self) -> bool:
        """Whether the whole run could be read; else an unbroken rule is not known to hold."""
        return not self.gaps

    def apply(self, entry: facts.Entry) -> None:
        """Check the next entry. Entries with the same number are one event."""
        if self._check_shortened(entry):
            self.skip_entry(entry, "")
            return
        if not (self._is_in_event and entry.number == self.world.event):
            self._finish_event()
            self._begin_event(entry)
        if self.history is not None:
            self.history.apply(entry)
        self.facts += len(entry.facts)
        for fact in entry.facts:
            if type(fact) is facts.Opened:
                self._open_segment(fact, entry)
            elif type(fact) is facts.Closed:
                if self.is_closed:
                    self.world.report(CLOCK, 0, "central closed the run a second time")
                self.is_closed = True
            else:
                apply_fact(self.world, fact)

    def _check_shortened(self, entry: facts.Entry) -> bool:
        """Add a gap for facts that ``tca log prune`` removed; return whether it has the entry."""
        for fact in entry.facts[1:2]:
            if isinstance(fact, facts.Shortened):
                self._shortened = fact.until
                ended = f"what had ended by {fact.until:.2f} s was removed"
                self.gaps.append(f"{ended}: only later entries are checked")
        return entry.time <= self._shortened

    def skip_places(self, places: int) -> None:
        """Skip places that can't be read. Nothing more is claimed about messages sent before them.

        Args:
            places: The number of such places before the next entry.
        """
        if not places:
            return
        self._finish_event()
        which = f"{places} entries or more" if places > 1 else "an entry, or more,"
        self._reset(f"after {self.world.now:.2f} s {which} can't be read")

    def skip_entry(self, entry: facts.Entry, why: str) -> None:
        """Skip an entry. Nothing is claimed about the entry and about messages sent before it.

        Args:
            entry: The entry.
            why: The reason, as a gap in words.
        """
        is_same = self._is_in_event and entry.number == self.world.event
        self._finish_event()
        if self.history is not None:
            self.history.apply(entry)
        self._record_extent(entry)
        for fact in entry.facts:
            if isinstance(fact, facts.Opened):
                self._epoch, self._segment = fact.epoch, fact.segment
            elif isinstance(fact, facts.FormatDefined):
                presence.format_defined(self.world, fact)
        self.is_closed = any(isinstance(fact, facts.Closed) for fact in entry.facts)
        self.facts += len(entry.facts)
        self.events += not is_same
        self._reset(why)
        self.world.events += not is_same
        self.world.now = entry.time

    def _reset(self, why: str) -> None:
        """Forget the messages under way, but retain the declarations."""
        known = self.world
        if why:
            self.gaps.append(f"{why}: the messages under way then are unknown")
        self.world = JournalWorld(self.violations, is_whole=False, events=known.events)
        self.world.now, self.world.declared = known.now, known.declared
        self.world.cycles, self.world.accepting = known.cycles, known.accepting
        self._may_have_missed_opening = True

    def _begin_event(self, entry: facts.Entry) -> None:
        world = self.world
        self._record_extent(entry)
        is_opening = bool(entry.facts) and isinstance(entry.facts[0], facts.Opened)
        if self.events and not is_opening:
            self._check_clock(entry)
        elif not (self.events or is_opening or self._may_have_missed_opening):
            self.gaps.append(
                "it starts in the middle of a segment: messages sent before are unknown"
            )
        world.forget()
        world.begin(entry)
        self._is_in_event = True
        self.events += 1

    def _record_extent(self, entry: facts.Entry) -> None:
        """Record the start of the journal and its last entry so far."""
        if not self.events:
            self.began, self.first = entry.time, entry.number
        self.last = entry.number

    def _check_clock(self, entry: facts.Entry) -> None:
        world = self.world
        if entry.time < world.now or entry.number < world.event:
            before = f"entry {world.event} at {world.now:g} s"
            after = f"entry {entry.number} at {entry.time:g} s"
            world.report(CLOCK, 0, f"{after} comes after {before}")
        elif self.is_closed:
            world.report(CLOCK, 0, f"entry {entry.number} comes after central closed the run")

    def _finish_event(self) -> None:
        if not self._is_in_event:
            return
        self._is_in_event = False
        world = self.world
        finish_event(world)
        world.history = self.history
        self._ask_properties(world)
        world.events += 1

    def _open_segment(self, fact: facts.Opened, entry: facts.Entry) -> None:
        """Apply the start of a segment: of this run, of another one, or after missing segments."""
        is_other = fact.epoch != self._epoch
        is_next = fact.segment == self._segment + 1
        if is_other or not is_next:
            if is_other and self._epoch:
                self.gaps.append(f"at {entry.time:.2f} s another run starts ({fact.epoch})")
            if (not is_other or fact.segment != 1) and not self._may_have_missed_opening:
                missing = fact.segment - 1 - (0 if is_other else self._segment)
                which = f"{missing} segment{'s' * (missing != 1)} before segment {fact.segment}"
                self.gaps.append(
                    f"missing: {which}; messages sent before {entry.time:.2f} s are unknown"
                )
            is_first = is_other and fact.segment == 1
            self.world = JournalWorld(self.violations, is_whole=is_first, events=self.world.events)
            self.world.begin(entry)
        self._epoch, self._segment, self.is_closed = fact.epoch, fact.segment, False
        self._may_have_missed_opening = False

    # --- properties -------------------------------------------------------------------------------

    def _ask_properties(self, world: JournalWorld) -> None:
        """Ask the properties after an event.

        They see the messages that this event or the previous event changed, since some states last
        for one event only.
        """
        if not self.judges:
            return
        changed = self._changed_before | world.touched
        self._changed_before = world.touched.copy()
        self.messages.update(item.message for item in world.touched if item.is_new)
        self.modules.update(world.joined)
        for judge in list(self.unbroken):
            self._ask(judge, partial(judge.after, world, changed), world.events)

    def _ask(self, judge: Judge, ask: Callable[[], str], place: int) -> None:
        """Ask a property after the event at a place, and record a breach."""
        try:
            wrong = ask()
        except Exception as error:  # an error in the property, not in the robot
            raise BadProperty(
                f"property '{judge.prop}' can't be asked: {type(error).__name__}: {error}"
            ) from error
        if wrong:
            self.unbroken.remove(judge)
            words, world = str(judge.prop), self.world
            self.violations.append(
                Violation(words, "", place, world.event, world.now, judge.culprit, wrong)
            )

    def close(self) -> None:
        """Finish the check at the end of the journal."""
        self._finish_event()
        for judge in list(self.unbroken):
            self._ask(judge, partial(judge.at_end, self.world), max(self.world.events - 1, 0))

    def misnamed(self) -> dict[Property, str]:
        """Return the properties with names or data that the journal does not allow, and the errors.

        Because of the mistake, such a property would hold in any run.
        """
        world = self.world
        messages = self.messages | world.declared.keys()
        found = {}
        for judge in self.judges:
            for one in judge.prop.predicates:
                if isinstance(one, OfMessages) and one.is_typed:
                    misfit = "" if judge.matches.has_subject(one) else _misfit(one, world)
                    unknown = _unknown("message", one.message, messages)
                    unknown = unknown or _unknown("module", one.module, self.modules)
                    if wrong := unknown or misfit:
                        found[judge.prop] = wrong
        return found


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    if not name or name in known:
        return ""
    return f"the journal has no {kind} '{name}'{did_you_mean(name, known, ': ')}"


def _misfit(predicate: OfMessages, world: JournalWorld) -> str:
    """Return why the declarations rule out a predicate's data; "" if they do not."""
    name = predicate.message
    formats = [one.data for one in world.declared.values() if name in ("", one.message)]
    values = [one for one in predicate.data if isinstance(one, FieldValue)] if formats else []
    wrong = next(filter(None, (one.misfit(formats) for one in values)), "")
    return f"of '{name}', {wrong}" if wrong and name else wrong

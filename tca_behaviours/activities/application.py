"""An application: components, and the processors that tick their activities, allocated anew
whenever it is wanted.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import inf
from typing import Annotated, Any

import msgspec

from tca_behaviours.activities.analysis import Demand, Policy, automatic, one_each, one_for_all
from tca_behaviours.activities.components import Component, initialise
from tca_behaviours.activities.figures import allocation_report, application_figures
from tca_behaviours.activities.processing import Baton, VirtualBaton
from tca_behaviours.activities.processing.schedule import Processor, Schedule
from tca_behaviours.activities.reports import AllocationReport, ApplicationFigures
from tca_module import MisuseError, checks
from tca_module.checks import check

POLICIES: dict[str, Policy] = {
    "one_for_all": one_for_all,
    "one_each": one_each,
    "automatic": automatic,
}
"""By their names."""
BY_HAND = "by hand"

_Allocation = dict[Annotated[str, msgspec.Meta(min_length=1)], list[str]]
_POSITION = checks.whole("0 or more", 0, inf).or_none()
_PRIORITY = checks.whole("a whole number", -(2**63 - 1))


class Application:
    """Components whose activities are ticked by processors, as a policy or the user allocates them.

    All its methods are for any thread, and all but ``initialise`` for ticks. Changes while it runs
    neither lose a tick nor double one. With a ``VirtualBaton`` it has no threads, and time passes
    when its ``run`` is called.
    """

    def __init__(
        self,
        name: str,
        components: Iterable[Component[Any]] = (),
        policy: Policy | Mapping[str, Sequence[str]] = one_for_all,
        *,
        baton: Baton | VirtualBaton | None = None,
    ) -> None:
        self.name = name
        self.components: dict[str, Component[Any]] = {}
        self.policy = BY_HAND
        self._baton = baton or Baton()
        self._started_at = self._stopped_at = 0.0
        self._changed: list[Callable[[], object]] = []
        self._added: list[Callable[[Component[Any]], object]] = []
        for component in components:
            self._add(component)
        self.allocate(policy)

    def __repr__(self) -> str:
        return f"Application '{self.name}'"

    def add(self, component: Component[Any]) -> None:
        """One component more. The policy allocates all activities anew. Without a policy, by hand,
        the new activities are on no processor yet.
        """
        self._add(component)
        self._tell()
        if self.policy in POLICIES:
            self.allocate(POLICIES[self.policy])

    def _add(self, component: Component[Any]) -> None:
        if component.name in self.components:
            raise MisuseError(
                f"two components are called '{component.name}': give one of them another name"
            )
        activities = component.activities()
        if self.is_running and not component.is_initialised:
            component.initialise()
        with self._baton.changing() as schedule:
            for activity in activities:
                schedule.add(activity)
        self.components = {
            **self.components,
            component.name: component,
        }  # other threads go through the old one
        for function in self._added:
            function(component)

    # --- at work ----------------------------------------------------------------------------------

    @property
    def is_running(self) -> bool:
        """Whether activities are ticked."""
        return self._baton.is_running

    def initialise(self) -> None:
        """Let all components begin anew, together. Only while nothing is ticked."""
        if self.is_running:
            raise MisuseError(f"{self!r} is running: call stop() before initialise()")
        initialise(self.components.values())

    def start(self) -> None:
        """Tick the activities: all are due at once. Components must have been initialised."""
        if new := [
            component for component in self.components.values() if not component.is_initialised
        ]:
            raise MisuseError(f"{new[0]!r} is not initialised: call initialise() before start()")
        if not self.is_running:
            self._started_at = self._baton.clock()
        self._baton.start()
        self._tell()

    def stop(self) -> None:
        """Tick no more. The tick that runs is waited for, unless it is the one that calls this."""
        if self.is_running:
            self._stopped_at = self._baton.clock()
        self._baton.stop()
        self._tell()

    @contextmanager
    def running(self) -> Iterator["Application"]:
        """A block in which it runs, newly initialised."""
        self.initialise()
        self.start()
        try:
            yield self
        finally:
            self.stop()

    # --- who ticks what ---------------------------------------------------------------------------

    @property
    def activity_names(self) -> list[str]:
        """In the order of components, and in each in the order of its ``activities``."""
        return list(self._baton.schedule.activities)

    def allocate(self, policy: Policy | Mapping[str, Sequence[str]]) -> None:
        """Allocate all activities by a policy, or by hand: the names of activities in order of
        subscription, by processors. ``automatic`` needs an execution time of each activity:
        declared, or measured in a run before.
        """
        allocation = _checked(policy(self._demands(policy)) if callable(policy) else policy)
        _check_complete(allocation, self._baton.schedule)
        ready = self._baton.ready(allocation)
        with self._baton.changing() as schedule:
            _check_complete(allocation, schedule)  # by now there may be others
            now = self._baton.clock()
            processors = [
                schedule.processor(name) or ready.get(name) or Processor(name, now)
                for name in allocation
            ]
            for processor, activities in zip(processors, allocation.values(), strict=True):
                processor.priority = 0
                for each in activities:
                    schedule.put(schedule.activities[each], processor, now)
            schedule.processors = processors
            self.policy = next(
                (name for name, known in POLICIES.items() if known is policy), BY_HAND
            )
        self._tell()

    def move(self, activity: str, processor: str, position: int | None = None) -> None:
        """Let another processor tick an activity: one that is there, or a new one of that name. It
        is subscribed last, or at a position (0 is the first). A processor without activities goes.
        """
        check("move()", checks.LABEL, processor=processor)
        check("move()", _POSITION, position=position)
        with self._by_hand() as schedule:
            now = self._baton.clock()
            one = schedule.activity(activity)
            schedule.put(
                one,
                schedule.processor(processor) or schedule.new_processor(processor, now),
                now,
                position,
            )

    def remove(self, activity: str) -> None:
        """Nothing ticks an activity any more, until it is moved to a processor."""
        with self._by_hand() as schedule:
            schedule.take_off(schedule.activity(activity))

    def set_period(self, activity: str, seconds: float) -> None:
        """Change the period of an activity. It counts from the tick before; a tick that is due
        stays due.
        """
        with self._baton.changing() as schedule:
            schedule.set_period(schedule.activity(activity), seconds, self._baton.clock())
        self._tell()

    def set_priority(self, processor: str, priority: int) -> None:
        """The higher one goes first. All begin with 0, and among equal ones the shorter period goes
        first.
        """
        check("set_priority()", _PRIORITY, priority=priority)
        with self._by_hand() as schedule:
            processors = {one.name: one for one in schedule.processors}
            checks.check_known("there is no processor", processor, processors)
            processors[processor].priority = priority

    def on_change(self, function: Callable[[], object]) -> None:
        """Call a function after each change of the allocation, and after start and stop: in the
        thread that makes the change.
        """
        self._changed.append(function)

    def on_add(self, function: Callable[[Component[Any]], object]) -> None:
        """Call a function with each component, those that are added later included: before they are
        ticked.
        """
        self._added.append(function)
        for component in self.components.values():
            function(component)

    # --- what is known of it ----------------------------------------------------------------------

    def allocation(self) -> AllocationReport:
        """How activities are allocated now."""
        with self._baton.lock:
            return allocation_report(self.name, self.policy, self.is_running, self._baton.schedule)

    def figures(self) -> ApplicationFigures:
        """What was measured so far, and what analysis says."""
        with self._baton.lock:
            now = self._baton.clock()
            running_for = (now if self.is_running else self._stopped_at) - self._started_at
            return application_figures(self.name, running_for, now, self._baton.schedule)

    # --- inside -----------------------------------------------------------------------------------

    @contextmanager
    def _by_hand(self) -> Iterator[Schedule]:
        """A change after which no policy says any more how activities are allocated."""
        with self._baton.changing() as schedule:
            yield schedule
            self.policy = BY_HAND
        self._tell()

    def _demands(self, policy: Policy) -> list[Demand]:
        with self._baton.lock:
            activities = list(self._baton.schedule.activities.values())
            costs = {one.name: one.cost for one in activities}
        unknown = [name for name, cost in costs.items() if cost is None]
        if unknown and policy is automatic:
            raise MisuseError(
                f"'{unknown[0]}' has neither an estimate nor a measured time: declare one, or run another policy first"
            )
        return [Demand(one.name, one.period, costs[one.name] or 0.0) for one in activities]

    def _tell(self) -> None:
        for function in self._changed:
            function()


def _checked(allocation: Mapping[str, Sequence[str]]) -> _Allocation:
    """One whose processors and activities have names."""
    try:
        return msgspec.convert(allocation, _Allocation)
    except msgspec.ValidationError as error:
        wanted = f"a policy ({', '.join(POLICIES)}) or a dictionary of lists of names"
        raise MisuseError(f"an allocation is {wanted}, not {allocation!r:.60}: {error}") from None


def _check_complete(allocation: _Allocation, schedule: Schedule) -> None:
    """Each activity once."""
    places = [name for names in allocation.values() for name in names]
    for name in places:
        schedule.activity(name)
        if places.count(name) > 1:
            raise MisuseError(f"activity '{name}' is allocated twice: give it one processor")
    if missing := [name for name in schedule.activities if name not in places]:
        raise MisuseError(
            f"activity '{missing[0]}' is on no processor: allocate each activity once"
        )

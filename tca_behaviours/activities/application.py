"""An application: components, and the processors that tick their activities."""

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
"""The policies, by name."""
BY_HAND = "by hand"

_Allocation = dict[Annotated[str, msgspec.Meta(min_length=1)], list[str]]
_POSITION = checks.whole("0 or more", 0, inf).or_none()
_PRIORITY = checks.whole("a whole number", -(2**63 - 1))


class Application:
    """Components, and processors that tick their activities. A policy or the user allocates the
    activities to the processors.

    Its methods can be called from any thread, and all but ``initialise`` from ticks. A change of a
    running application neither loses a tick nor adds one. With a ``VirtualBaton`` the application
    has no threads, and time passes only in the baton's ``run``.

    Args:
        name: the name of the application.
        components: the components; ``add`` can add others later.
        policy: allocates the activities to processors: ``one_for_all`` (the default), ``one_each``,
            ``automatic``, or a dictionary of lists of activity names, by processor.
        baton: runs the schedule. Default: in threads.

    Example::

        with Application("cart", [wheel, arm], one_each).running() as application:
            time.sleep(10.0)
            print(application.figures())
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
        self._change_observers: list[Callable[[], object]] = []
        self._add_observers: list[Callable[[Component[Any]], object]] = []
        for component in components:
            self._add(component)
        self.allocate(policy)

    def __repr__(self) -> str:
        return f"Application '{self.name}'"

    def add(self, component: Component[Any]) -> None:
        """Add a component.

        The policy then allocates all activities again. Without a policy (by hand), the new
        activities are on no processor yet.

        Args:
            component: the component; its name must be new.

        Raises:
            MisuseError: the name of the component, or of one of its activities, is in use.
            UnsoundMachine: one of its regions can't be run.
        """
        self._add(component)
        self._notify()
        if self.policy in POLICIES:
            self.allocate(POLICIES[self.policy])

    def _add(self, component: Component[Any]) -> None:
        if component.name in self.components:
            raise MisuseError(
                f"two components are called '{component.name}': give one of them another name"
            )
        activities = component.activities()
        for region in component.regions.values():
            region.clock = self._baton.clock
        if self.is_running and not component.is_initialised:
            component.initialise()
        with self._baton.changing() as schedule:
            for activity in activities:
                schedule.add(activity)
        # A new dictionary: other threads may iterate over the old one.
        self.components = {**self.components, component.name: component}
        for function in self._add_observers:
            function(component)

    # --- running ----------------------------------------------------------------------------------

    @property
    def is_running(self) -> bool:
        """Whether activities are ticked."""
        return self._baton.is_running

    def initialise(self) -> None:
        """Reset all components to their first states, together.

        Raises:
            MisuseError: the application is running.
        """
        if self.is_running:
            raise MisuseError(f"{self!r} is running: call stop() before initialise()")
        initialise(self.components.values())

    def start(self) -> None:
        """Start to tick the activities; all are due at once.

        Raises:
            MisuseError: a component is not initialised.
        """
        if new := [
            component for component in self.components.values() if not component.is_initialised
        ]:
            raise MisuseError(f"{new[0]!r} is not initialised: call initialise() before start()")
        if not self.is_running:
            self._started_at = self._baton.clock()
        self._baton.start()
        self._notify()

    def stop(self) -> None:
        """Stop ticking, and wait for the end of a running tick. If that tick calls ``stop`` itself,
        do not wait.
        """
        if self.is_running:
            self._stopped_at = self._baton.clock()
        self._baton.stop()
        self._notify()

    @contextmanager
    def running(self) -> Iterator["Application"]:
        """Start a ``with`` block in which the application runs, newly initialised.

        Yields:
            The application.
        """
        self.initialise()
        self.start()
        try:
            yield self
        finally:
            self.stop()

    # --- allocation -------------------------------------------------------------------------------

    @property
    def activity_names(self) -> list[str]:
        """The names of all activities, in the order of components, then of their ``activities``."""
        return list(self._baton.schedule.activities)

    def allocate(self, policy: Policy | Mapping[str, Sequence[str]]) -> None:
        """Allocate all activities to processors. All processors get priority 0.

        Args:
            policy: a policy such as ``one_each``; or a dictionary of lists of activity names, by
                processor, each list in order of subscription. ``automatic`` needs an execution time
                of each activity: a declared one, or one measured in an earlier run.

        Raises:
            MisuseError: an activity is missing, unknown, allocated twice, or lacks an execution
                time.
        """
        allocation = _checked_shape(policy(self._demands(policy)) if callable(policy) else policy)
        _check_complete(allocation, self._baton.schedule)
        prepared = self._baton.prepare(allocation)
        with self._baton.changing() as schedule:
            _check_complete(allocation, schedule)  # others may be added by now
            now = self._baton.clock()
            processors = [
                schedule.processor(name) or prepared.get(name) or Processor(name, now)
                for name in allocation
            ]
            for processor, activities in zip(processors, allocation.values(), strict=True):
                processor.priority = 0
                for activity in activities:
                    schedule.put(schedule.activities[activity], processor, now)
            schedule.processors = processors
            self.policy = next(
                (name for name, known in POLICIES.items() if known is policy), BY_HAND
            )
        self._notify()

    def move(self, activity: str, processor: str, position: int | None = None) -> None:
        """Move an activity to another processor, or to another position.

        A processor that loses its last activity is removed.

        Args:
            activity: the name of the activity.
            processor: the name of an existing or a new processor.
            position: the activity's place in the processor's order of subscription, from 0; None:
                the last.

        Raises:
            MisuseError: there is no such activity, or an argument does not fit.
        """
        check("move()", checks.LABEL, processor=processor)
        check("move()", _POSITION, position=position)
        with self._changing_by_hand() as schedule:
            now = self._baton.clock()
            scheduled = schedule.activity(activity)
            schedule.put(
                scheduled,
                schedule.processor(processor) or schedule.new_processor(processor, now),
                now,
                position,
            )

    def remove(self, activity: str) -> None:
        """Remove an activity from its processor.

        The activity is not ticked until ``move`` puts it on a processor.

        Args:
            activity: the name of the activity.

        Raises:
            MisuseError: there is no such activity.
        """
        with self._changing_by_hand() as schedule:
            schedule.unassign(schedule.activity(activity))

    def set_period(self, activity: str, seconds: float) -> None:
        """Change the period of an activity.

        The new period counts from the last tick. A tick that is due stays due.

        Args:
            activity: the name of the activity.
            seconds: the new period, in seconds.

        Raises:
            MisuseError: there is no such activity, or the period is shorter than its declared
                execution time.
        """
        with self._baton.changing() as schedule:
            schedule.set_period(schedule.activity(activity), seconds, self._baton.clock())
        self._notify()

    def set_priority(self, processor: str, priority: int) -> None:
        """Set the priority of a processor; the higher one goes first.

        All processors start with priority 0. Among equal priorities the shorter period goes first.

        Args:
            processor: the name of the processor.
            priority: a whole number.

        Raises:
            MisuseError: there is no such processor, or *priority* is no whole number.
        """
        check("set_priority()", _PRIORITY, priority=priority)
        with self._changing_by_hand() as schedule:
            processors = {one.name: one for one in schedule.processors}
            checks.check_known("there is no processor", processor, processors)
            processors[processor].priority = priority

    def on_change(self, function: Callable[[], object]) -> None:
        """Call a function after each change of the allocation, and after start and stop.

        Args:
            function: a function without arguments. It is called in the thread that makes the
                change.
        """
        self._change_observers.append(function)

    def on_add(self, function: Callable[[Component[Any]], object]) -> None:
        """Call a function with each present component now, and with each later one.

        Args:
            function: a function that takes the component. For a later component it is called before
                the component's first tick.
        """
        self._add_observers.append(function)
        for component in self.components.values():
            function(component)

    # --- reports ----------------------------------------------------------------------------------

    def allocation(self) -> AllocationReport:
        """Return the present allocation of the activities."""
        with self._baton.lock:
            return allocation_report(self.name, self.policy, self.is_running, self._baton.schedule)

    def figures(self) -> ApplicationFigures:
        """Return the measured figures, and the results of the analysis."""
        with self._baton.lock:
            now = self._baton.clock()
            running_for = (now if self.is_running else self._stopped_at) - self._started_at
            return application_figures(self.name, running_for, now, self._baton.schedule)

    # --- inside -----------------------------------------------------------------------------------

    @contextmanager
    def _changing_by_hand(self) -> Iterator[Schedule]:
        """A block that changes the schedule by hand. After the block, no policy determines the
        allocation.
        """
        with self._baton.changing() as schedule:
            yield schedule
            self.policy = BY_HAND
        self._notify()

    def _demands(self, policy: Policy) -> list[Demand]:
        with self._baton.lock:
            activities = list(self._baton.schedule.activities.values())
            costs = {activity.name: activity.cost for activity in activities}
        unknown = [name for name, cost in costs.items() if cost is None]
        if unknown and policy is automatic:
            raise MisuseError(
                f"'{unknown[0]}' has neither an estimate nor a measured time: "
                "declare one, or run another policy first"
            )
        return [Demand(one.name, one.period, costs[one.name] or 0.0) for one in activities]

    def _notify(self) -> None:
        for function in self._change_observers:
            function()


def _checked_shape(allocation: Mapping[str, Sequence[str]]) -> _Allocation:
    """Return the allocation as a dictionary of lists. Raises MisuseError if it has another
    shape.
    """
    try:
        return msgspec.convert(allocation, _Allocation)
    except msgspec.ValidationError as error:
        wanted = f"a policy ({', '.join(POLICIES)}) or a dictionary of lists of names"
        raise MisuseError(f"an allocation is {wanted}, not {allocation!r:.60}: {error}") from None


def _check_complete(allocation: _Allocation, schedule: Schedule) -> None:
    """Check that each activity is allocated exactly once."""
    places = [name for names in allocation.values() for name in names]
    for name in places:
        schedule.activity(name)
        if places.count(name) > 1:
            raise MisuseError(f"activity '{name}' is allocated twice: give it one processor")
    if missing := [name for name in schedule.activities if name not in places]:
        raise MisuseError(
            f"activity '{missing[0]}' is on no processor: allocate each activity once"
        )

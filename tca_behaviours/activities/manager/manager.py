"""The manager: publishes an application through the user's module, and handles the commands that
change it.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from tca_behaviours.activities.application import POLICIES, Application
from tca_behaviours.activities.components import Component, Region, RegionChange
from tca_behaviours.activities.manager import messages
from tca_module import Callback, CentralLost, MisuseError, Module, Sender, Task, Timeout
from tca_module.checks import check_known

PERIOD = 0.1
"""Seconds between two publications of changes."""

_MAX_WAITING = 10_000
"""The most transitions that wait to be published."""

_PICTURES, _FIGURES = 2, 10
"""The numbers of periods between two pictures, and between two reports of figures."""


class Manager:
    """Publishes an application in central, and lets other programs control it.

    Args:
        application: the application.
        controls: buttons for the application's page.
        picture: draws the application's picture for the page, as SVG.

    Example::

        manager = Manager(application)
        module = Module("cart")
        manager.handle_in(module)
        with module.running(), application.running():
            ...
    """

    def __init__(
        self,
        application: Application,
        *,
        controls: Iterable[messages.Control] = (),
        picture: Callable[[], str] | None = None,
    ) -> None:
        self.application = application
        self.messages = messages.ApplicationMessages(application.name)
        self._controls = list(controls)
        self._picture = picture
        self._published_picture = ""
        self._module_name = ""
        self._changes: deque[RegionChange] = deque(maxlen=_MAX_WAITING)
        self._is_reallocated = False
        self._must_publish_all = False
        self._periods = 0
        application.on_change(self._on_reallocation)
        application.on_add(self._on_component)

    def handle_in(self, module: Module) -> None:
        """Let a module publish the application and handle its commands, once the module runs.

        The manager uses a resource of its own, so that other handlers of the module do not delay
        it.

        Args:
            module: the module; it must not run yet.
        """
        self._module_name, application = module.name, self.application
        resource = module.resource(f"application {application.name}")
        module.at_start(self._publish_all)
        module.every(PERIOD, resource=resource)(self._publish)
        changes: dict[Any, Callable[[Any], object]] = {
            self.messages.allocate: application.allocate,
            self.messages.move: self._move,
            self.messages.set_period: lambda new: application.set_period(new.activity, new.period),
            self.messages.set_priority: lambda new: application.set_priority(
                new.processor, new.priority
            ),
            self.messages.set_policy: self._set_policy,
            self.messages.initialise: lambda _: application.initialise(),
            self.messages.start: lambda _: application.start(),
            self.messages.stop: lambda _: application.stop(),
        }
        for message, change in changes.items():
            module.handles(message, resource=resource)(_handler(change))

    # --- commands ---------------------------------------------------------------------------------

    def _move(self, move: messages.ActivityMove) -> None:
        if move.processor:
            self.application.move(move.activity, move.processor, move.position)
        else:
            self.application.remove(move.activity)

    def _set_policy(self, name: str) -> None:
        check_known("there is no policy", name, POLICIES)
        self.application.allocate(POLICIES[name])

    # --- publication ------------------------------------------------------------------------------

    def _on_reallocation(self) -> None:
        self._is_reallocated = True

    def _on_component(self, component: Component[Any]) -> None:
        for region in component.regions.values():
            region.on_transition(self._changes.append)
        self._must_publish_all = True

    def _publish(self, sender: Callback) -> None:
        self._periods += 1
        try:
            self._publish_changes(sender)
        except (CentralLost, Timeout):
            self._must_publish_all = True  # reports of this period may be lost

    def _publish_changes(self, sender: Sender) -> None:
        """Publish the changes. Publish everything if a component was added, or if central is new or
        was away.
        """
        has_figures = self._periods % _FIGURES == 0
        if self._must_publish_all or (
            has_figures and sender.get_variable(self.messages.application, None) is None
        ):
            self._publish_all(sender)
        if self._changes:
            self._publish_states(sender)
        if self._is_reallocated:
            self._publish_allocation(sender)
        if self._periods % _PICTURES == 0:
            self._publish_picture(sender)
        if has_figures:
            sender.set_variable(self.messages.figures, self.application.figures(), wait=False)

    def _publish_all(self, sender: Sender) -> None:
        self._must_publish_all = False
        name, components = self.application.name, self.application.components
        entries = [
            messages.ComponentEntry(each.name, [region.chart for region in each.regions.values()])
            for each in components.values()
        ]
        entry = messages.ApplicationEntry(
            name, self._module_name, entries, list(POLICIES), self._controls
        )
        self._published_picture = ""
        sender.set_variable(self.messages.application, entry)
        self._publish_allocation(sender)
        sender.set_variable(self.messages.figures, self.application.figures())
        self._publish_states(sender)
        self._publish_picture(sender)

    def _publish_allocation(self, sender: Sender) -> None:
        self._is_reallocated = False
        sender.set_variable(self.messages.allocation, self.application.allocation())

    def _publish_states(self, sender: Sender) -> None:
        changes = list(self._changes)
        states = {f"{region.component}.{region.name}": region.current for region in self._regions()}
        sender.set_variable(self.messages.states, messages.StatesReport(states, changes))
        for change in changes:  # remove a change only after central has it
            if self._changes[0] is change:  # else the full queue has dropped it since
                self._changes.popleft()

    def _publish_picture(self, sender: Sender) -> None:
        if self._picture is not None and (picture := self._picture()) != self._published_picture:
            self._published_picture = picture
            sender.set_variable(self.messages.picture, picture, wait=False)

    def _regions(self) -> list[Region]:
        components = self.application.components.values()
        return [region for component in components for region in component.regions.values()]


def _handler(change: Callable[[Any], object]) -> Callable[..., None]:
    """Make a handler that calls *change* with the data of a command. The command fails if the call
    raises MisuseError.
    """

    def handle(_task: Task, data: Any = None) -> None:
        try:
            change(data)
        except MisuseError as error:
            raise messages.REFUSED(text=str(error)) from None

    return handle

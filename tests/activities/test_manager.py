"""An application in central: its published variables, and the commands that change it."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import pytest
from activities.joint import Joint

from tca_behaviours.activities import Application, VirtualBaton, one_for_all
from tca_behaviours.activities.manager import (
    ActivityMove,
    ActivityPeriod,
    ApplicationMessages,
    Control,
    Manager,
    ProcessorPriority,
)
from tca_module import Callback, Client, Command, MisuseError, Module, TaskFailed, connect
from tca_module.testing import LocalCentral

NAMES = ApplicationMessages("robot")


class Town(NamedTuple):
    central: LocalCentral
    user: Client
    joint: Joint
    baton: VirtualBaton
    application: Application

    def carry_out(self, message: Command[Any, None], data: Any = None) -> None:
        """Send a command, and let its effects be published. Raises TaskFailed."""
        sent = self.user.command(message, data)
        self.central.advance(0.1)
        sent.result(timeout=5)

    def allocated(self) -> dict[str, list[str]]:
        """Return the published allocation to processors."""
        report = self.user.get_variable(NAMES.allocation)
        return {one.name: [each.name for each in one.activities] for one in report.processors}


@pytest.fixture
def short_queue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the manager keep at most three unpublished transitions."""
    monkeypatch.setattr("tca_behaviours.activities.manager.manager._MAX_WAITING", 3)


@pytest.fixture
def town() -> Iterator[Town]:
    joint = Joint()
    baton = VirtualBaton()
    application = Application("robot", [joint], one_for_all, baton=baton)
    application.initialise()
    with LocalCentral(stepped=True) as central, connect("user", central) as user:
        module = Module("robot", central)
        controls = [Control("enable", "enable", group="joint")]
        Manager(
            application, controls=controls, picture=lambda: f"<svg>{joint.position.value}</svg>"
        ).handle_in(module)
        with module.running():
            yield Town(central, user, joint, baton, application)


def test_manager_publishes_the_application_in_variables(town: Town) -> None:
    entry = town.user.get_variable(NAMES.application)
    assert (entry.name, entry.module, entry.policies) == (
        "robot",
        "robot",
        ["one_for_all", "one_each", "automatic"],
    )
    (component,) = entry.components
    movement = component.regions[3]
    states = [(state.label, state.parent) for state in movement.states]
    assert states == [("stopped", -1), ("moving", -1), ("fast", 1), ("slow", 1)]
    assert [control.label for control in entry.controls] == ["enable"]
    assert town.user.get_variable(NAMES.states).states["x.enabling"] == "disabled"
    assert town.user.get_variable(NAMES.picture) == "<svg>None</svg>"
    assert not town.user.get_variable(NAMES.allocation).is_running


def test_every_transition_is_published(town: Town) -> None:
    town.carry_out(NAMES.start)
    town.joint.command.put("enable")
    town.joint.command.put("disable")
    town.baton.run(0.1)
    town.central.advance(0.1)
    published = town.user.get_variable(NAMES.states)
    assert published.states["x.enabling"] == "disabled"
    assert [
        (f"{one.component}.{one.region}", one.source, one.target, one.event)
        for one in published.changes
    ] == [
        ("x.enabling", "disabled", "enabled", "enable"),
        ("x.enabling", "enabled", "disabled", "disable"),
    ]
    town.central.advance(1.0)
    figures = {one.name: one.ticks for one in town.user.get_variable(NAMES.figures).activities}
    assert figures["x.enabling.machine"] == 10


@pytest.mark.usefixtures("short_queue")
def test_transition_during_publication_is_published(
    town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    published: list[str] = []
    set_variable = Callback.set_variable

    def disable_meanwhile(self: Callback, variable: Any, value: Any, **how: Any) -> None:
        set_variable(self, variable, value, **how)
        if variable.name == NAMES.states.name:
            published.extend(change.event for change in value.changes)
            if len(published) == 3:
                town.joint.command.put("disable")
                town.baton.run(0.1)

    monkeypatch.setattr(Callback, "set_variable", disable_meanwhile)
    town.carry_out(NAMES.start)
    for event in ("enable", "disable", "enable"):
        town.joint.command.put(event)
    town.baton.run(0.1)
    town.central.advance(0.2)
    assert published == ["enable", "disable", "enable", "disable"]


def test_added_component_is_published(town: Town) -> None:
    town.carry_out(NAMES.start)
    late = Joint("late")
    town.application.add(late)
    late.command.put("enable")
    town.baton.run(0.1)
    town.central.advance(0.1)
    assert [one.name for one in town.user.get_variable(NAMES.application).components] == [
        "x",
        "late",
    ]
    assert "late.movement.machine" in town.allocated()["all"]
    published = town.user.get_variable(NAMES.states)
    assert published.states["late.enabling"] == "enabled"
    assert ("late", "enabling", "enable") in [
        (one.component, one.region, one.event) for one in published.changes
    ]


def test_commands_change_the_allocation(town: Town) -> None:
    town.carry_out(NAMES.set_policy, "one_each")
    assert len(town.allocated()) == len(town.application.activity_names)
    town.carry_out(NAMES.allocate, {"all": town.application.activity_names})
    assert list(town.allocated()) == ["all"]
    town.carry_out(NAMES.move, ActivityMove("x.movement.fast", "fast"))
    town.carry_out(NAMES.move, ActivityMove("x.movement.slow", "fast", 0))
    assert town.allocated()["fast"] == ["x.movement.slow", "x.movement.fast"]
    town.carry_out(NAMES.move, ActivityMove("x.movement.fast", ""))
    report = town.user.get_variable(NAMES.allocation)
    assert (report.policy, [one.name for one in report.unallocated]) == (
        "by hand",
        ["x.movement.fast"],
    )
    town.carry_out(NAMES.set_priority, ProcessorPriority("fast", 3))
    town.carry_out(NAMES.set_period, ActivityPeriod("x.movement.slow", 0.5))
    first = town.user.get_variable(NAMES.allocation).processors[0]
    assert (first.name, first.priority, first.period) == ("fast", 3, 0.5)


def test_invalid_control_is_rejected() -> None:
    assert Control("on", "lamp", {"": True}).data == {"": True}
    with pytest.raises(MisuseError) as refused:
        Control("on", Command("lamp", bool))  # type: ignore[arg-type]
    assert str(refused.value).startswith(
        "control 'on': message must be a name, such as MESSAGE.name, not Command('lamp'"
    )
    with pytest.raises(
        MisuseError, match="control 'on': data must be a dictionary of texts, numbers and bools"
    ):
        Control("on", "lamp", {"a": None})  # type: ignore[dict-item]
    with pytest.raises(
        MisuseError, match="control 'on': data must be a dictionary of texts, numbers and bools"
    ):
        Control("on", "lamp", True)  # type: ignore[arg-type]
    with pytest.raises(MisuseError, match="control 'on': fields must be a list of ControlFields"):
        Control("on", "lamp", fields=["speed"])  # type: ignore[list-item]


def test_application_starts_stops_and_initialises_by_command(town: Town) -> None:
    town.carry_out(NAMES.start)
    assert town.user.get_variable(NAMES.allocation).is_running
    with pytest.raises(TaskFailed, match="call stop"):
        town.carry_out(NAMES.initialise)
    town.carry_out(NAMES.stop)
    town.carry_out(NAMES.initialise)
    assert not town.user.get_variable(NAMES.allocation).is_running


@pytest.mark.parametrize(
    ("message", "data", "why"),
    [
        (
            NAMES.set_policy,
            "best",
            "there is no policy 'best': there are one_for_all, one_each, automatic",
        ),
        (NAMES.allocate, {"all": []}, "x.port handler"),
        (NAMES.move, ActivityMove("z", "all"), "'z'"),
        (NAMES.set_period, ActivityPeriod("x.movement.fast", 0.0), "0"),
        (NAMES.set_priority, ProcessorPriority("best", 1), "'best'"),
        (NAMES.set_policy, "automatic", "neither an estimate nor a measured time"),
    ],
)
def test_invalid_application_command_fails_with_the_reason(
    town: Town, message: Command[Any, None], data: Any, why: str
) -> None:
    with pytest.raises(TaskFailed) as failed:
        town.carry_out(message, data)
    assert failed.value.failure == "application refused"
    assert why in str(failed.value)

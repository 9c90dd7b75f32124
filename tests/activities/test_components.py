"""A joint with four regions, ticked by the test."""

import sys
import threading
from collections.abc import Callable
from typing import Any

import pytest
from activities.joint import Joint, Target

from tca_behaviours.activities.components import (
    Component,
    Region,
    RegionChange,
    connect,
    initialise,
)
from tca_module import MisuseError


def tick(joint: Component[Any], times: int = 1) -> None:
    for _ in range(times):
        for activity in joint.activities():
            activity.tick()


def states(joint: Joint) -> dict[str, str]:
    return {region.name: region.current for region in joint.regions.values()}


@pytest.fixture
def joint() -> Joint:
    joint = Joint()
    joint.initialise()
    return joint


def ready(joint: Joint) -> Joint:
    joint.command.put("enable")
    tick(joint)
    joint.command.put("reference")
    tick(joint, 10)
    return joint


def test_joint_is_enabled_referenced_and_moved(joint: Joint) -> None:
    assert states(joint) == {
        "limits": "inside",
        "referencing": "unreferenced",
        "enabling": "disabled",
        "movement": "stopped",
    }
    ready(joint)
    assert states(joint)["referencing"] == "referenced"
    joint.target.put(Target(0.3))
    tick(joint)
    assert joint.regions["movement"].path == ("moving", "fast")
    tick(joint, 20)
    assert states(joint)["movement"] == "stopped"
    assert joint.position.value == pytest.approx(0.3)


def test_region_transition_needs_states_of_other_regions(joint: Joint) -> None:
    joint.command.put("reference")  # not enabled: no transition for the event
    tick(joint)
    joint.command.put("enable")
    tick(joint, 5)
    assert states(joint)["referencing"] == "unreferenced"
    joint.target.put(Target(0.3))
    tick(joint)
    assert states(joint)["movement"] == "stopped"


def test_event_reaches_all_regions(joint: Joint) -> None:
    ready(joint).target.put(Target(0.9))
    tick(joint)
    joint.command.put("disable")
    tick(joint)
    assert (states(joint)["movement"], states(joint)["enabling"]) == ("stopped", "disabled")


def test_tick_makes_at_most_one_transition(joint: Joint) -> None:
    changes: list[RegionChange] = []
    joint.regions["enabling"].on_transition(changes.append)
    for event in ("enable", "enable", "disable"):
        joint.post(event)
    handler = next(one for one in joint.activities() if one.name == "x.enabling.machine")
    handler.tick()
    assert changes == [RegionChange("x", "enabling", "disabled", "enabled", "enable")]
    assert str(changes[0]) == "x.enabling: disabled to enabled (enable)"
    handler.tick()  # the second "enable" has no transition
    assert changes[1:] == [RegionChange("x", "enabling", "enabled", "disabled", "disable")]


def test_activities_are_listed_in_declaration_order(joint: Joint) -> None:
    assert [(one.name, one.period, one.estimate) for one in joint.activities()] == [
        ("x.port handler", 0.01, None),
        ("x.limits.machine", 0.01, None),
        ("x.referencing.machine", 0.01, None),
        ("x.enabling.machine", 0.01, None),
        ("x.movement.machine", 0.01, None),
        ("x.referencing.searching", 0.01, None),
        ("x.movement.fast", 0.01, 0.0001),
        ("x.movement.slow", 0.02, None),
    ]


def test_component_can_be_initialised_again(joint: Joint) -> None:
    first = states(joint)
    changes: list[RegionChange] = []
    joint.regions["movement"].on_transition(changes.append)
    ready(joint).target.put(Target(0.9))
    tick(joint)
    joint.command.put("stop")
    tick(joint)
    assert joint.position.value is not None
    joint.target.put(Target(0.1))
    joint.target.put(Target(0.2))
    joint.post("disable")
    changes.clear()
    joint.initialise()
    assert joint.position.value is None
    assert joint.target.lost == 0
    assert [str(change) for change in changes] == ["x.movement: start to stopped"]
    tick(joint, 3)
    assert states(joint) == first


def test_transition_without_event_is_taken_when_its_guard_holds(joint: Joint) -> None:
    """The joint slows down near its target, and stops outside its range."""
    ready(joint).target.put(Target(2.0))
    changes: list[RegionChange] = []
    for region in joint.regions.values():
        region.on_transition(changes.append)
    tick(joint, 30)
    assert [str(change) for change in changes] == [
        "x.movement: stopped to fast (move)",
        "x.limits: inside to beyond",
        "x.movement: fast to stopped (stop)",
    ]
    joint.target.put(Target(0.9))
    tick(joint)
    assert states(joint)["movement"] == "stopped"  # outside its range

    joint.initialise()
    changes.clear()
    ready(joint).target.put(Target(0.3))
    tick(joint, 20)
    assert [change.target for change in changes if change.region == "movement"] == [
        "fast",
        "slow",
        "stopped",
    ]


class Chain(Component[None]):
    """A component that records entries and exits of its states."""

    def __init__(self, log: list[str]) -> None:
        super().__init__("chain", lambda: None)
        region = self.region("only", period=1.0)

        def steps(name: str) -> dict[str, Any]:
            return {"entry": lambda: log.append(f"+{name}"), "exit": lambda: log.append(f"-{name}")}

        outer = region.state("outer", **steps("outer"))
        one, two = outer.state("one", **steps("one")), outer.state("two", **steps("two"))
        other = region.state("other", **steps("other"))
        one.to(two, on="next")
        two.to(two, on="next", when=lambda: True)
        outer.to(other, on="next")  # transitions of inner states come first
        outer.to(other, on="out")
        outer.to(one, on="again")
        other.to(two, on="back")


def test_states_exit_inside_out_and_enter_outside_in() -> None:
    log: list[str] = []
    chain = Chain(log)
    chain.initialise()
    entries = []
    for event in ("next", "next", "again", "out", "back"):
        entries.append(" ".join(log))
        log.clear()
        chain.post(event)
        tick(chain)
    entries.append(" ".join(log))
    assert entries == [
        "+outer +one",
        "-one +two",
        "-two +two",
        "-two -outer +outer +one",
        "-one -outer +other",
        "-other +outer +two",
    ]


# --- ports ----------------------------------------------------------------------------------------


def test_port_rejects_values_of_another_type(joint: Joint) -> None:
    with pytest.raises(
        MisuseError, match=r"port x\.target \(Target\) does not accept 0\.3, of type float"
    ):
        joint.target.put(0.3)  # type: ignore[arg-type]
    with pytest.raises(
        MisuseError, match=r"port x\.position \(float\) does not accept 'far', of type str"
    ):
        joint.position.set("far")  # type: ignore[arg-type]
    joint.position.set(1)  # an int is accepted as a float, as by type checkers
    with pytest.raises(
        MisuseError,
        match=r"port x\.position \(float\) can't be connected with x\.target \(Target\)",
    ):
        connect(joint.position, joint.target)  # type: ignore[misc]
    with pytest.raises(
        MisuseError, match=r"connect\(\) needs an output port and an input port, not x\.target"
    ):
        connect(joint.target, joint.target)  # type: ignore[arg-type]


def test_port_keeps_the_newest_value_or_a_queue(joint: Joint) -> None:
    for number in range(10):
        joint.command.put(f"{number}")
        joint.target.put(Target(number))
    assert (joint.command.lost, joint.target.lost) == (2, 9)


class Watch(Component[list[float]]):
    """A component that records the values that it receives."""

    def __init__(self, name: str, *, begins: bool) -> None:
        super().__init__(name, list)
        self.seen = self.input("seen", float, self.see, keep=9)
        self.all = self.output("all", float)
        self.begins = begins
        self.region("only", period=1.0).state("there", entry=self.begin_there)

    def see(self, value: float) -> None:
        self.data.append(value)

    def begin_there(self) -> None:
        if self.begins:
            self.all.set(1.5)


def test_value_set_at_initialisation_arrives() -> None:
    components = [Watch("a", begins=True), Watch("b", begins=False)]
    for one, other in (components, components[::-1]):
        connect(one.all, other.seen)
    for order in (components, components[::-1]):
        initialise(order)
        tick(components[1])
        with components[1].exclusion:
            assert components[1].data == [1.5]


# --- data -----------------------------------------------------------------------------------------


def test_component_data_is_accessible_to_its_activities_only(joint: Joint) -> None:
    with pytest.raises(
        MisuseError, match="the data of Joint 'x' are for its own activities: use a port"
    ):
        _ = joint.data


def test_tick_sees_consistent_data_under_concurrent_ticks() -> None:
    class Pair(Component[dict[str, int]]):
        def __init__(self) -> None:
            super().__init__("pair", lambda: {"left": 0, "right": 0})
            self.region("only", period=1.0).state("counting", activity=self.count, period=1.0)

        def count(self) -> None:
            assert self.data["left"] == self.data["right"]
            self.data["left"] += 1
            self.data["right"] = self.data["left"]

    pair = Pair()
    pair.initialise()
    _, counting = pair.activities()

    def tick_often() -> None:
        for _ in range(300):
            counting.tick()

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=tick_often) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    with pair.exclusion:
        assert pair.data == {"left": 1200, "right": 1200}


# --- errors ---------------------------------------------------------------------------------------


def test_raising_activity_leaves_the_component_usable(joint: Joint) -> None:
    joint.command.put("fly")
    with pytest.raises(
        MisuseError,
        match="Joint 'x' has no event 'fly': there are disable, enable, move, reference, stop, switch",
    ):
        tick(joint)
    ready(joint)
    assert states(joint)["referencing"] == "referenced"


class Bare(Component[None]):
    def __init__(self) -> None:
        super().__init__("bare", lambda: None)


def two(region: Region, on: str = "", needs: str = "") -> None:
    region.state("a").to(region.state("b"), on=on, needs=[needs] if needs else [])


def test_invalid_component_is_rejected(approve: Callable[..., None]) -> None:
    def message_of(case: str) -> str:
        bare = Bare()
        with pytest.raises(MisuseError) as error:
            (
                eval(case, globals(), {"bare": bare, "only": bare.region("only", period=1.0)}),
                bare.activities(),
            )
        return str(error.value)

    approve("bad_components.txt", message_of)

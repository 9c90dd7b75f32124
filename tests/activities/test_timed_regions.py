"""Transitions that a region makes when it has been in a state for a time."""

import pytest

from tca_behaviours.activities import Application, VirtualBaton
from tca_behaviours.activities.components import Component, Region
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_module import MisuseError


class Lamp(Component[list[str]]):
    """A lamp that goes out by itself."""

    def __init__(self, baton: VirtualBaton) -> None:
        super().__init__("lamp", list)
        power = self.region("power", period=0.1)
        off, on = power.state("off"), power.state("on")
        bright, dim = on.state("bright"), on.state("dim")
        off.to(on, on="press")
        on.to(on, on="press")
        bright.after(1.0, dim)
        on.after(2.0, off)
        self.made: list[str] = []
        power.on_transition(lambda change: self.made.append(f"{baton.clock():.1f} {change}"))


def test_region_leaves_states_after_their_times() -> None:
    baton = VirtualBaton(cost=lambda _: 0.0)
    lamp = Lamp(baton)
    application = Application("test", [lamp], baton=baton)
    with application.running():
        lamp.post("press")
        baton.run(1.5)
        lamp.post("press")
        baton.run(5.0)
    assert lamp.made[1:] == [
        "0.0 lamp.power: off to bright (press)",
        "1.0 lamp.power: bright to dim (after 1 s)",
        "1.5 lamp.power: dim to bright (press)",
        "2.5 lamp.power: bright to dim (after 1 s)",
        "3.5 lamp.power: dim to off (after 2 s)",
    ]


def test_time_is_no_event_of_its_component() -> None:
    lamp = Lamp(VirtualBaton())
    lamp.activities()
    timed = lamp.regions["power"].states["bright"].timed
    assert timed is not None
    with pytest.raises(MisuseError, match="there are press"):
        lamp.post(timed.event)


def test_wrong_time_of_a_region_is_refused() -> None:
    region, other = Region("x", "y", 1.0, None), Region("x", "z", 1.0, None)
    first, second, third = region.state("a"), region.state("b"), region.state("c")
    with pytest.raises(MisuseError, match="seconds must be more than 0 seconds"):
        first.after(0.0, second)
    with pytest.raises(MisuseError, match="in another region"):
        first.after(1.0, other.state("d"))
    first.after(1.0, second)
    with pytest.raises(MisuseError, match="is given twice"):
        first.after(2.0, third)
    with pytest.raises(UnsoundMachine, match=r"'x\.y\.c' can't be reached"):
        region.check()

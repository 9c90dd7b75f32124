"""Each of the other programs alone, and all five in one process."""

import pytest
from courier.arm import make_arm
from courier.battery import make_battery
from courier.map import mapper
from courier.messages import (
    CHARGE,
    CONSUMED,
    DELIVER,
    DRIVE,
    GRASP,
    PUT_DOWN,
    ROUTE,
    Parcel,
    Trip,
)
from courier.planner import planner
from courier.wheels import wheels

from tca_module import Outcome, QueryFailed, connect
from tca_module.testing import LocalCentral


def test_route_names_the_rooms_on_the_way(tca_central: LocalCentral) -> None:
    tca_central.start(mapper)
    with connect("test", tca_central) as user:
        assert user.query(ROUTE, Trip("store", "hall"), timeout=5) == ["kitchen", "hall"]
        assert user.query(ROUTE, Trip("hall", "hall"), timeout=5) == []


def test_route_to_an_unknown_room_fails(tca_central: LocalCentral) -> None:
    tca_central.start(mapper)
    with connect("test", tca_central) as user, pytest.raises(QueryFailed, match="no route"):
        user.query(ROUTE, Trip("hall", "moon"), timeout=5)


def test_drive_takes_time_and_charge(tca_central: LocalCentral) -> None:
    consumed = tca_central.fake(CONSUMED)
    tca_central.start(wheels)
    drive = wheels.command(DRIVE, "hall")
    tca_central.advance(0.05)
    assert not consumed.calls
    tca_central.advance(0.05)
    assert consumed.calls == [0.02]
    assert drive.result(timeout=5) == 5.0


def test_arm_refuses_a_second_parcel(tca_central: LocalCentral) -> None:
    arm = make_arm()
    tca_central.start(arm)
    assert arm.command(GRASP, "book").wait(timeout=5) is Outcome.DONE
    assert arm.command(GRASP, "cup").wait(timeout=5) is Outcome.FAILED
    assert arm.command(PUT_DOWN, "book").wait(timeout=5) is Outcome.DONE


def test_all_programs_deliver_a_parcel(tca_central: LocalCentral) -> None:
    battery = make_battery(charge=0.5)
    tca_central.start(mapper, battery, wheels, make_arm(), planner)
    delivery = planner.goal(DELIVER, Parcel("book", Trip("store", "office")))
    tca_central.advance(10)
    assert delivery.wait(timeout=5) is Outcome.DONE
    assert battery.query(CHARGE, timeout=5) == pytest.approx(0.4)

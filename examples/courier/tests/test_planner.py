"""The planner alone. All other programs are fakes, and the clock is advanced by the tests."""

import pytest
from courier.messages import (
    BLOCKED,
    CHARGE,
    DELIVER,
    DRIVE,
    GRASP,
    NO_ROUTE,
    PUT_DOWN,
    ROUTE,
    Parcel,
    Trip,
)
from courier.planner import planner

from tca_module import Outcome, SentTask
from tca_module.rig import Fake
from tca_module.testing import LocalCentral

PARCEL = Parcel("book", Trip("kitchen", "store"))


pytestmark = pytest.mark.usefixtures("drive")


@pytest.fixture
def drive(tca_central: LocalCentral) -> Fake:
    """Return the fake of the wheels. The arm, the map and the battery are fakes, too."""
    tca_central.fake(CHARGE, returns=0.9)
    tca_central.fake(ROUTE, returns=lambda _, trip: [trip.end])
    tca_central.fake(GRASP)
    tca_central.fake(PUT_DOWN)
    return tca_central.fake(DRIVE, returns=5.0)


def deliver(central: LocalCentral) -> SentTask[None]:
    central.start(planner)
    delivery = planner.goal(DELIVER, PARCEL)
    central.until_quiet()
    return delivery


def test_delivery_drives_to_the_parcel_then_to_its_end(
    tca_central: LocalCentral, drive: Fake
) -> None:
    assert deliver(tca_central).wait(timeout=5) is Outcome.DONE
    assert drive.calls == ["kitchen", "store"]


def test_parcel_is_put_down_after_the_last_drive(tca_central: LocalCentral) -> None:
    deliver(tca_central)
    lines = tca_central.transcript().splitlines()
    delivered = [line.split()[2] for line in lines if " delivered: " in line]
    assert delivered[-4:] == ["drive", "grasp", "drive", "put"]


def test_blocked_drive_is_tried_again_after_ten_seconds(
    tca_central: LocalCentral,
) -> None:
    again = tca_central.fake(DRIVE, returns=[BLOCKED("a chair"), 5.0, 5.0])
    delivery = deliver(tca_central)
    tca_central.advance(9.9)
    assert again.calls == ["kitchen"]
    tca_central.advance(0.1)
    assert again.calls == ["kitchen", "kitchen", "store"]
    assert delivery.wait(timeout=5) is Outcome.DONE


def test_delivery_fails_after_three_blocked_drives(tca_central: LocalCentral) -> None:
    blocked = tca_central.fake(DRIVE, fails=BLOCKED("a wall"))
    delivery = deliver(tca_central)
    tca_central.advance(60)
    assert delivery.wait(timeout=5) is Outcome.FAILED
    assert len(blocked.calls) == 3


def test_weak_battery_ends_the_delivery_before_any_drive(
    tca_central: LocalCentral, drive: Fake
) -> None:
    tca_central.fake(CHARGE, returns=0.1)
    assert deliver(tca_central).wait(timeout=5) is Outcome.FAILED
    assert not drive.calls


def test_delivery_without_a_route_fails(tca_central: LocalCentral, drive: Fake) -> None:
    tca_central.fake(ROUTE, fails=NO_ROUTE(PARCEL.trip))
    assert deliver(tca_central).wait(timeout=5) is Outcome.FAILED
    assert not drive.calls

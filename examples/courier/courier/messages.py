"""The messages of the robot."""

from dataclasses import dataclass

from tca_module import Command, ExceptionHandler, Failure, Goal, Inform, Query


@dataclass
class Trip:
    start: str
    end: str


@dataclass
class Parcel:
    name: str
    trip: Trip


DELIVER = Goal("deliver", Parcel)
DRIVE = Command("drive", str, result=float)  # to a room; the result is the way in metres
GRASP, PUT_DOWN = Command("grasp", str), Command("put down", str)
ROUTE = Query("route", Trip, reply=list[str])
CHARGE = Query("charge", reply=float)  # from 0 to 1
CONSUMED = Inform("consumed", float)

BLOCKED = Failure("blocked", str)
NO_ROUTE = Failure("no route", Trip)
TOO_WEAK = Failure("too weak", float)
TRY_AGAIN = ExceptionHandler("try again")

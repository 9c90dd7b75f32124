"""Grasp parcels, one at a time."""

from courier.messages import GRASP, PUT_DOWN
from tca_module import Failure, Module, Task

HANDS_FULL = Failure("hands full", str)


def make_arm() -> Module:
    arm, held = Module("arm"), list[str]()

    @arm.handles(GRASP)
    def grasp(_: Task, parcel: str) -> None:
        if held:
            raise HANDS_FULL(held[0])
        held.append(parcel)

    @arm.handles(PUT_DOWN)
    def put_down(_: Task, parcel: str) -> None:
        held.remove(parcel)

    return arm


if __name__ == "__main__":
    make_arm().run()

"""Ports connected with central. Messages arrive and values are sent; no tick waits for central."""

import pytest
from activities.joint import Joint, Target

from tca_behaviours.activities.central_ports import publish, receive
from tca_module import Broadcast, Inform, MisuseError, Module, Task, Variable, connect
from tca_module.testing import LocalCentral

MOVE, COMMAND = Inform("move x", Target), Broadcast("command", str)
POSITION, POSITIONS = Variable("position of x", float), Inform("positions of x", float)


def tick(joint: Joint, times: int) -> None:
    for _ in range(times):
        for activity in joint.activities():
            activity.tick()


def test_joint_is_controlled_through_central_ports() -> None:
    joint = Joint()
    joint.initialise()
    seen: list[float] = []
    with LocalCentral(stepped=True) as central:
        robot, chart = Module("robot", central), Module("chart", central)
        receive(robot, MOVE, joint.target)
        receive(robot, COMMAND, joint.command)
        publish(robot, joint.position, POSITION)
        publish(robot, joint.position, POSITIONS)

        @chart.handles(POSITIONS)
        def note(_: Task, position: float) -> None:
            seen.append(round(position, 3))

        with robot.running(), chart.running(), connect("panel", central) as panel:
            for command in ("enable", "reference"):
                panel.broadcast(COMMAND, command)
                central.until_quiet()
                tick(joint, 20)
            for position in (0.3, 0.6):
                panel.inform(MOVE, Target(position))
                central.until_quiet()
                tick(joint, 20)
            assert seen == []
            central.advance(0.05)
            assert seen == [0.3, 0.6]
            assert panel.get_variable(POSITION) == pytest.approx(0.6)


def test_central_port_rejects_a_message_of_another_type() -> None:
    with LocalCentral() as central, pytest.raises(MisuseError) as error:
        receive(Module("robot", central), Inform("move x", float), Joint().target)  # type: ignore[misc]
    assert str(error.value) == (
        "inform 'move x' has data of type float, but port is x.target (Target): use one type"
    )

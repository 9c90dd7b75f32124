"""A preview: while the base drives, the arm already moves to the box that is likely to be free."""

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Coordination,
    Coordinator,
    Discrete,
    Do,
    Perceived,
    progress_only,
)
from tca_module import Command, Module, Task, Variable

MOVE_BASE = Command("move base", str, progress=float)
MOVE_ARM = Command("move arm", str, progress=float)
DROP, BOX_B_FREE = Command("drop"), Variable("box B is free", bool)
base, arm, gripper = Agent("base"), Agent("arm"), Agent("gripper")

with Coordination("deliver", facts={"base": "A", "arm": "home"}) as deliver:
    to_b = deliver.state("going to B", Activity(Do(MOVE_BASE, "B", base), makes={"base": "B"}))
    arm_b = deliver.state("arm to box B", Activity(Do(MOVE_ARM, "B", arm), makes={"arm": "B"}))
    to_c = deliver.state("going to C", Activity(Do(MOVE_BASE, "C", base), makes={"base": "C"}))
    arm_c = deliver.state("arm to box C", Activity(Do(MOVE_ARM, "C", arm), makes={"arm": "C"}))
    in_b, in_c = {"base": "B", "arm": "B"}, {"base": "C", "arm": "C"}
    drop_b = deliver.state("dropping in B", Activity(Do(DROP, None, gripper), needs=in_b))
    drop_c = deliver.state("dropping in C", Activity(Do(DROP, None, gripper), needs=in_c))
    delivered = deliver.final("delivered")
    to_b.to(arm_b, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
    to_b.to(to_c, likelihood=Perceived(BOX_B_FREE, negated=True))
    arm_b.to(drop_b)
    to_c.to(arm_c)
    arm_c.to(drop_c)
    drop_b.to(delivered)
    drop_c.to(delivered)

robot = Module("robot")


@robot.handles(MOVE_BASE, resource="base")
def move_base(task: Task, place: str) -> None:
    for step in range(1, 11):
        task.sleep(0.05)
        task.report(step / 10)
    print("base is at", place)


@robot.handles(MOVE_ARM, resource="arm", takes=["cancel"])
def move_arm(task: Task, box: str) -> None:
    print("arm begins to move to box", box)
    if box == "B":
        task.set_variable(BOX_B_FREE, False)  # an object is put there
    if task.wait_for_request(0.2):
        print("arm stops on its way to box", box)
        raise task.aborted()
    print("arm is at box", box)


@robot.handles(DROP, resource="gripper")
def drop(_: Task) -> None:
    print("dropped")


if __name__ == "__main__":
    coordinator = Coordinator(deliver, policy=Discrete(0.4, utility=progress_only))
    coordinator.handle_in(robot)
    with robot.running(patience=2):
        robot.set_variable(BOX_B_FREE, True)
        print(coordinator.run(robot))

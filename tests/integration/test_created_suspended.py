"""Two commands are created and then ordered, the newer one first. Their handlers are idle
meanwhile, in another process.
"""

from contextlib import suppress
from pathlib import Path

from module.real_central import SOON
from processes import central, program

from tca_module import Command, Goal, Module, Refused, Task

WALK, STEP = Goal("walk", bool), Command("step", str, result=float)
LEGS = """
    import time
    from tca_module import Command, Module, Task
    legs = Module("legs")
    legs.resource("legs", capacity=2)
    @legs.handles(Command("step", str, result=float))
    def step(task: Task, name: str) -> float:
        return time.monotonic()
    legs.run()
"""
TIMES = 20


def test_constraint_between_suspended_tasks_is_never_too_late(tmp_path: Path) -> None:
    lost: list[bool] = []

    with central(tmp_path) as daemon, program(LEGS, daemon.address):
        planner = Module("planner", daemon.address)

        @planner.handles(WALK)
        def walk(task: Task, suspended: bool) -> None:
            first, second = (
                task.command(STEP, one, sequential=False, suspended=suspended) for one in ("a", "b")
            )
            with suppress(Refused):  # the first command has started
                task.constrain(second.achieving.end <= first.achieving.start)
            if suspended:
                first.resume()
                second.resume()
            lost.append(first.result(SOON) < second.result(SOON))

        with planner.running():
            planner.wait_until_handled(STEP, timeout=SOON)
            for suspended in (False, True):
                lost.clear()
                for _ in range(TIMES):
                    planner.goal(WALK, suspended).wait(SOON)
                assert len(lost) == TIMES
                assert any(lost) is not suspended

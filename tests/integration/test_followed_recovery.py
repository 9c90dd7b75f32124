"""Central is killed and restarted while clients follow, observe, update and cancel a task. The
clients notice nothing.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import Central, program

from tca_module import Command, Outcome, Rejected, connect

pytestmark = pytest.mark.slow

WATCH = Command("watch", float, progress=float)

CAMERA = """
    import sys
    from tca_module import Command, Module

    camera = Module("camera")

    @camera.handles(Command("watch", float, progress=float), takes=["update", "cancel"])
    def watch(task, angle):
        task.report(angle)
        for request in task.requests():
            if request.transition == "cancel":
                raise task.aborted()
            if request.goal > 90:
                request.reject("too far")
            else:
                request.accept()
                task.report(request.goal)

    with camera.running():
        print("runs", flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def central(tmp_path: Path) -> Iterator[list[Central]]:
    running = [Central(tmp_path)]
    with program(CAMERA, running[0].address) as camera:
        camera.hear("runs")
        yield running
    running[-1].stop()


def kill(central: list[Central]) -> None:
    central[-1].kill()


def test_task_is_updated_and_cancelled_through_central_restarts(
    central: list[Central], tmp_path: Path
) -> None:
    with (
        connect("user", central[0].address, patience=20) as user,
        connect("visitor", central[0].address) as visitor,
    ):
        observed = visitor.observe(WATCH, timeout=20)
        watch = user.command(WATCH, 1.0)
        changes, progress = watch.changes(timeout=20), watch.progress(float, timeout=20)
        assert next(progress) == 1.0
        assert next(observed).state == "initiated"
        for angle in (2.0, 3.0):
            kill(central)
            pending = watch.update_send(angle)
            central.append(Central(tmp_path))
            pending.wait(20)
            assert next(progress) == angle
            with pytest.raises(Rejected, match="too far"):
                watch.update(91.0, timeout=20)
        kill(central)
        watch.cancel("enough")
        central.append(Central(tmp_path))
        assert watch.wait(20) is Outcome.KILLED
        first, *seen = changes
        assert sum(one.missed + 1 for one in seen) == seen[-1].serial - first.serial, (
            "each change was seen, or counted as missed"
        )
        assert seen[-1].state == "cancelled"
        assert next(change for change in observed if change.is_over).task.id == watch.id

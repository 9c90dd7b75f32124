"""The open tasks of a client that leaves: they continue and are named, or they are cancelled."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import RealCentral, until
from processes import program

from tca_module import Client, Command, Goal, MisuseError, Module, Outcome, Task, connect

pytestmark = pytest.mark.slow

WALK, TURN, STAND = Goal("walk", int), Command("turn", int), Command("stand", int)

SCRIPT = """
    import sys
    from tca_module import Command, Goal, connect

    user = connect("script"{how})
    user.command(Command("stand", int), 1).wait()
    user.goal(Goal("walk", int), 2).id
    print("sent", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """Return the address of a central with a module whose walks and turns last until the end."""
    legs, wheels = Module("legs", f"ipc://{tmp_path}/c.sock"), Module("wheels")
    wheels.central = legs.central

    @legs.handles(WALK)
    @wheels.handles(TURN)
    def last(task: Task, _: int) -> None:
        while not task.cancelled:
            task.sleep(0.01)

    @wheels.handles(STAND)
    def stand(_task: Task, _number: int) -> None:
        pass

    with RealCentral(f"ipc://{tmp_path}/c.sock"), legs.running(), wheels.running():
        yield f"ipc://{tmp_path}/c.sock"


@pytest.fixture
def observer(address: str) -> Iterator[Client]:
    with connect("observer", address) as client:
        yield client


def open_walks(observer: Client) -> list[int]:
    return [task.id for task in observer.tasks(WALK)]


def test_client_tasks_are_cancelled_on_leave(address: str, observer: Client) -> None:
    with connect("user", address, on_leave="cancel") as user:
        walk, turn = user.goal(WALK, 1), user.command(TURN, 2)
        others = observer.goal(WALK, 3)
        numbers = walk.id, turn.id
    outcomes = [task.wait(20) for one in numbers if (task := observer.task(one)) is not None]
    assert set(outcomes) <= {Outcome.KILLED}
    assert open_walks(observer) == [others.id]
    others.kill()


def test_client_tasks_are_cancelled_when_its_process_dies(address: str, observer: Client) -> None:
    script = program(SCRIPT.format(how=", on_leave='cancel'"), address)
    script.hear("sent")
    assert len(open_walks(observer)) == 1
    script.close()
    until(lambda: not open_walks(observer), "the walk has ended")


@pytest.mark.parametrize("how", ["", ", on_leave='keep'"])
def test_open_tasks_are_named_once_unless_told_how(
    address: str, observer: Client, how: str
) -> None:
    _, errors = program(SCRIPT.format(how=how), address).communicate()
    walks = open_walks(observer)
    assert len(walks) == 1
    assert errors.count(f"walk {{{walks[0]}}}") == (0 if how else 1)
    assert "stand" not in errors
    observer.tasks(WALK)[0].kill()


def test_script_without_open_tasks_prints_nothing(address: str) -> None:
    script = program(
        SCRIPT.format(how="").replace('user.goal(Goal("walk", int), 2).id', ""), address
    )
    assert script.communicate() == ("sent\n", "")


def test_unknown_way_to_leave_is_refused(address: str) -> None:
    with pytest.raises(MisuseError, match="'cancel'"):
        connect("user", address, on_leave="kill")  # type: ignore[arg-type]

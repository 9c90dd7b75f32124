"""``tca cancel``, ``update`` and ``watch``: requests to a running task, and its states."""

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from integration.commanded import SOON, tca

from tca_module import (
    BASIC,
    GENERAL,
    Client,
    Command,
    LifeCycle,
    Module,
    Outcome,
    Party,
    SentTask,
    Task,
    Transition,
    connect,
    ending,
)
from tca_module.sending.task_ref import Change
from tca_module.testing import LocalCentral
from tca_tools.live import shared, states
from tca_tools.live.states import cancel, update, watch

PAUSABLE = LifeCycle(
    "pausable",
    [
        *GENERAL.transitions,
        Transition("pause", "running", "paused", Party.CLIENT),
        *ending("paused"),
    ],
)


@dataclass
class Grasp:
    width: float


WALK, TURN, STAND, LATER = (Command(name) for name in ("walk", "turn", "stand", "later"))
DRIFT = Command("drift", life_cycle=BASIC)
GRASP = Command("grasp", Grasp, result=float, progress=Grasp, life_cycle=PAUSABLE)


def test_send_follows_progress_and_states_of_a_known_message() -> None:
    with LocalCentral(stepped=True) as central:
        with connect("planner", central) as planner:
            planner.execute_if_handled(GRASP, Grasp(0.1))
            assert planner.declared("grasp").format == GRASP.format
            with connect("user", central) as user:
                assert user.execute(user.declared("grasp"), {"width": 0.1}).info() is not None


@pytest.fixture
def central(monkeypatch: pytest.MonkeyPatch) -> Iterator[LocalCentral]:
    """Run a local central to which the commands connect, too."""
    with LocalCentral() as local:
        monkeypatch.setattr(
            shared, "connect", lambda name, _, **options: connect(name, local, **options)
        )
        yield local


@pytest.fixture
def user(central: LocalCentral) -> Iterator[Client]:
    with connect("user", central) as client:
        yield client


@pytest.fixture
def arm(central: LocalCentral) -> Iterator[None]:
    """Run an arm that grasps until it is cancelled, and rejects a width below 1 cm."""
    arm = Module("arm", central)

    @arm.handles(GRASP, takes=["update", "cancel"])
    def grasp(task: Task, goal: Grasp) -> float:
        task.report(goal)
        while (request := task.wait_for_request(SOON)) is not None:
            if request.transition == "cancel":
                raise task.aborted()
            if request.goal.width < 0.01:
                request.reject("it would break")
                continue
            request.accept()
            task.report(request.goal)
        return goal.width

    with arm.running():
        yield


@pytest.mark.parametrize(
    ("message", "code", "said"),
    [
        (WALK, 0, "walk {1}: ends when its running handlers have returned"),
        (TURN, 0, "turn {1}: cancel requested; its handler decides"),
        (STAND, 1, "stand {1} continues: the handler of 'stand' takes no 'cancel'"),
        (LATER, 0, "later {1}: cancelled"),
        (
            DRIFT,
            1,
            "drift {1} is 'running', and life cycle 'basic' has no cancel from there: 'tca kill 1' ends it",
        ),
    ],
    ids=lambda one: getattr(one, "name", ""),
)
def test_cancel_reports_its_result(
    central: LocalCentral, user: Client, message: Command[None, None], code: int, said: str
) -> None:
    legs, is_released = Module("legs", central), threading.Event()

    def work(_: Task) -> None:
        is_released.wait(SOON)  # a kill does not end this wait

    legs.handles(TURN, takes=["cancel"])(work)
    for one, refuses in ((WALK, []), (STAND, ["cancel"]), (DRIFT, [])):
        legs.handles(one, refuses=refuses)(work)
    with legs.running():
        task = user.execute(message)
        while message is not LATER and not (info := task.info()).module:  # type: ignore[union-attr]
            assert info is not None
        assert tca(cancel, message.name) == (
            (0, f"{said}\n", "") if code == 0 else (1, "", f"{said}\n")
        )
        is_released.set()
        task.kill()


@pytest.fixture
def sent(arm: None, user: Client) -> SentTask[float]:
    sent = user.execute(GRASP, Grasp(0.1))
    assert next(sent.progress(Grasp, timeout=SOON)) == Grasp(0.1)
    return sent


def test_task_is_updated_and_cancelled(sent: SentTask[float]) -> None:
    assert tca(update, "grasp", "width=0.05") == (0, f"{sent}: has the new goal\n", "")
    assert tca(update, "grasp", "width=0.001")[::2] == (
        1,
        f"the update of {sent} was rejected: it would break\n",
    )
    assert tca(update, "grasp", "width=0.04", "--no-wait")[:2] == (
        0,
        f"{sent}: the new goal is asked for\n",
    )
    code, printed, _ = tca(cancel, "grasp", "--why", "it slips")
    assert code == 0
    # The handler cancels at once: before or after the command asks for the task's state.
    assert printed in (
        f"{sent}: cancel requested; its handler decides\n",
        f"{sent}: cancelled\n",
    )
    assert sent.wait(SOON) is Outcome.KILLED


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (
            ["grasp", "wide=1"],
            2,
            "command 'grasp' wants data of type Grasp: field 'wide' is unknown: did you mean 'width'?",
        ),
        (
            ["1", "width=1", "--no-wait", "--timeout", "1"],
            2,
            "--no-wait and --timeout exclude each other: leave one of them out",
        ),
        (["walk", "width=1"], 1, "no living task is called 'walk': living tasks are grasp {1}"),
    ],
)
@pytest.mark.usefixtures("sent")
def test_impossible_goal_is_refused(words: list[str], code: int, error: str) -> None:
    assert tca(update, *words) == (code, "", f"{error}\n")


def test_watch_follows_a_task_until_its_end(central: LocalCentral, sent: SentTask[float]) -> None:
    observers, number = central.core.observers.count, sent.id

    def steer() -> None:
        with connect("planner", central) as planner:
            while central.core.observers.count == observers:
                planner.modules()
            task = planner.task(number)
            assert task is not None
            widths = task.progress(timeout=SOON)
            assert next(widths) == {"width": 0.1}
            task.update(Grasp(0.05), message=GRASP, timeout=SOON)
            assert next(widths) == {"width": 0.05}
            task.cancel("it slips")

    steering = threading.Thread(target=steer)
    steering.start()
    code, text, error = tca(watch, str(number))
    steering.join(SOON)
    assert (code, error) == (0, "")
    assert [line.split("  ", 1)[1] for line in text.splitlines()] == [
        'grasp {1}  running  so far: {"width": 0.1}',
        'grasp {1}  update requested  update by planner: {"width": 0.05}',
        "grasp {1}  running  accept by arm",
        'grasp {1}  running  result available by arm: {"width": 0.05}',
        "grasp {1}  cancel requested  cancel by planner: it slips",
        "grasp {1}  cancelled  aborted: it slips (by planner)",
    ]


def test_watch_follows_descendants_until_the_task_ends(central: LocalCentral, user: Client) -> None:
    legs, feet, number = Module("legs", central), Module("feet", central), user.execute(DRIFT).id
    legs.handles(DRIFT)(lambda task: task.sleep(SOON))
    feet.handles(WALK)(lambda task: task.report())

    def walk() -> None:
        with connect("planner", central) as planner:
            while not central.core.observers.count:
                planner.modules()
            task = planner.task(number)
            assert task is not None
            try:
                planner.under(task).execute(WALK).wait(SOON)
            finally:
                task.kill()

    with legs.running(), feet.running():
        walking = threading.Thread(target=walk)
        walking.start()
        code, text, _ = tca(watch, "walk", "--under", "drift", "--state", "done", "--json")
        walking.join(SOON)
    (row,) = map(json.loads, text.splitlines())
    assert code == 0
    assert (row["task"], row["message"], row["state"], row["serial"]) == (
        number + 1,
        "walk",
        "done",
        3,
    )
    assert (row["transition"], row["by"], row["is_over"]) == ("completed", "server", True)


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (["grip"], 1, "no module has declared a message 'grip': did you mean 'grasp'?"),
        (["1", "--under", "1"], 2, "task 1 is one task: leave --under out"),
        (["--under", "walk"], 1, "no living task is called 'walk': living tasks are grasp {1}"),
        (["7"], 1, "there is no task {7}: living tasks are grasp {1}"),
    ],
)
@pytest.mark.usefixtures("sent")
def test_watch_refuses_what_cannot_be_watched(words: list[str], code: int, error: str) -> None:
    assert tca(watch, *words) == (code, "", f"{error}\n")


@pytest.mark.usefixtures("sent")
def test_watch_ends_with_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(client: Client, *_: object) -> Iterator[Change]:
        yield next(iter(client.observe("grasp", timeout=SOON)))
        raise KeyboardInterrupt

    monkeypatch.setattr(states, "_changes", interrupted)
    code, text, error = tca(watch)
    assert (code, text.split("  ", 1)[1], error) == (
        0,
        'grasp {1}  running  so far: {"width": 0.1}\n',
        "",
    )

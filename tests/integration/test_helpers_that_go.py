"""Programs of exception handlers that are killed or stopped while they are wanted."""

import signal
import time
from pathlib import Path

import pytest
from integration.programs import central, program

from tca_module import Command, ExceptionHandler, Failure, Module, Outcome, Task, connect

pytestmark = pytest.mark.slow

STEP, SLIPPED = Command("step"), Failure("slipped")
RECOVER, MAKE_SAFE = ExceptionHandler("recover"), ExceptionHandler("make safe")
SOON = 20.0

EXPERT = """
    import time
    from tca_module import ExceptionHandler, Module, Task
    expert = Module("expert")

    @expert.handles(ExceptionHandler("recover"))
    def recover(task: Task) -> None:
        print("asked", flush=True)
        while not task.cancelled:
            time.sleep(0.01)

    expert.run()
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_whoever_stands_by_is_asked_for_what_was_at_work_and_for_what_waited(
    tmp_path: Path, number: signal.Signals
) -> None:
    texts = []
    with central(tmp_path) as daemon:
        legs, office = Module("legs", daemon.address), Module("office", daemon.address)
        legs.resource("feet", capacity=2)

        @legs.handles(STEP, resource="feet")
        def step(_: Task) -> None:
            raise SLIPPED(text="on ice")

        @office.handles(MAKE_SAFE)
        def make_safe(task: Task) -> None:
            assert task.trouble
            texts.append(task.trouble.text)

        with legs.running(), office.running(), program(EXPERT, daemon.address) as expert:
            with connect("user", daemon.address) as user:
                user.wait_until_handled(RECOVER, timeout=SOON)
                user.on_failure(SLIPPED, MAKE_SAFE, of=STEP)
                user.on_failure(SLIPPED, RECOVER, of=STEP)
                steps = [user.command(STEP, sequential=False) for _ in range(2)]
                assert expert.stdout
                assert expert.stdout.readline() == "asked\n"
                deadline = time.monotonic() + SOON
                while len(user.tasks(RECOVER)) < 2:
                    assert time.monotonic() < deadline
                expert.send_signal(number)
                assert [one.wait(timeout=SOON) for one in steps] == [Outcome.DONE] * 2
    at_work, waiting = sorted(texts, key=lambda text: "any more" in text)
    assert "could not decide: module lost" in at_work
    assert waiting.endswith("could not decide: nobody handles 'recover' any more")

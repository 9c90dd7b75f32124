"""A process is killed while it has messages ahead, and has not said what it has handled of them."""

from pathlib import Path

import pytest
from integration.programs import central, program

from tca_central.requests.joining import MOST_AHEAD
from tca_module import Client, Query, QueryFailed, connect

pytestmark = pytest.mark.slow

DOUBLE = Query("double", int, reply=int)
SOON, MANY, DEADLY, LOST = 20.0, 400, -1, "module lost"

QUICK = """
    import os
    import signal
    from tca_module import Module, Query, Task
    quick = Module("quick")

    @quick.handles(Query("double", int, reply=int))
    def double(_: Task, number: int) -> int:
        if number < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return 2 * number

    quick.run()
"""


def answers(user: Client, numbers: list[int], address: str) -> list[int | str]:
    """The answers, or failures, of questions that are put at once. Another one who answers comes meanwhile."""
    asked = [user.query_send(DOUBLE, number) for number in numbers]
    found: list[int | str] = []
    with program(QUICK, address):
        for one in asked:
            try:
                found.append(one.receive(SOON))
            except QueryFailed as lost:
                found.append(lost.failure)
    return found


def test_what_it_may_have_handled_has_failed_and_the_rest_goes_to_the_next(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, connect("user", daemon.address) as user, program(QUICK, daemon.address):
        for number in range(20):
            assert user.query(DOUBLE, number, timeout=SOON) == 2 * number
        numbers = [*range(MANY), DEADLY, *range(MANY)]
        found = answers(user, numbers, daemon.address)
    assert found[MANY] == LOST
    assert found.count(LOST) <= MOST_AHEAD + 1
    assert all(answer in (LOST, 2 * number) for number, answer in zip(numbers, found, strict=True))

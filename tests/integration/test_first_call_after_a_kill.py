"""A client that did nothing while central was killed and begun anew, with real processes: its next call."""

import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from integration.programs import central

from tca_module import Client, Command, Query, Variable, connect

WORK, UNHEARD = Command("work", int), Command("unheard of", int)
LEVEL, HEIGHT, WHERE = Variable("level", int), Variable("height", int), Query("where", reply=int)


def set_to(user: Client, level: int) -> int:
    user.set_variable(LEVEL, level)
    return user.get_variable(LEVEL)


CALLS: dict[str, tuple[Callable[[Client], Any], Any]] = {
    "tasks": (lambda user: user.tasks(), []),
    "modules": (lambda user: "user" in [module.name for module in user.modules()], True),
    "handlers": (lambda user: user.handlers(WORK), []),
    "status": (lambda user: user.status()["tasks"], 0),
    "variable": (lambda user: user.get_variable(LEVEL, 7), 7),
    "declared": (lambda user: user.declared("work").name, "work"),
    "command": (lambda user: user.command(WORK, 2).id, 1),
    "command of another message": (lambda user: user.command(UNHEARD, 2).id, 2),
    "set a variable": (lambda user: set_to(user, 3), 3),
    "swap a variable": (lambda user: user.swap_variable(HEIGHT, 3), None),
    "ask": (lambda user: user.execute_if_handled(WHERE), None),
}


def test_a_client_that_slept_through_a_restart_loses_nothing(tmp_path: Path) -> None:
    """Each call is the first one of its user."""
    with ExitStack() as stack:
        first = stack.enter_context(central(tmp_path))
        users = {call: stack.enter_context(connect("user", first.address)) for call in CALLS}
        for user in users.values():
            user.command(WORK, 1)
            user.set_variable(LEVEL, 1)
            user.set_variable(HEIGHT, 1)
        first.signal(signal.SIGKILL)
        first.process.wait()
        stack.enter_context(central(tmp_path / "again", bind=first.address))
        told = {call: CALLS[call][0](user) for call, user in users.items()}
        assert told == {call: expected for call, (_, expected) in CALLS.items()}

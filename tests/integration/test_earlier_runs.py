"""What a program has attached, and does not attach anew when it is started again, is marked and taken away."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from integration.commanded import FELL, FIX, LATER, LOOK, MOVE, SAY_MOVE, SOON, WALK, tca
from module.real_central import until

from tca_module import Client, Condition, Module, connect
from tca_tools.live.questions import attached
from tca_tools.live.tasks import detach

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("find_central")]

_GUARD = """
import sys, threading
from integration.commanded import LATER, MOVE, SAY_MOVE
from tca_module import Condition, Module

guard = Module("guard")

@guard.at_start
def attach(guard):
    guard.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
    if "checks" in sys.argv:
        guard.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)

threading.Thread(target=lambda: (sys.stdin.read(), guard.stop()), daemon=True).start()
guard.run()
"""


def listed(kind: str) -> dict[str, dict[str, Any]]:
    """What is attached of a kind, by the name of the listener or handler."""
    name = {"exception_handlers": "handler", "wiretaps": "listener", "monitors": "monitor"}[kind]
    return {one[name]: one for one in json.loads(tca(attached, "--json")[1])[kind]}


def stale() -> list[str]:
    return [name for kind in ("exception_handlers", "wiretaps", "monitors")
            for name, one in listed(kind).items() if one["is_stale"]]  # fmt: skip


def test_a_wiretap_that_an_edited_program_no_longer_makes_is_marked_and_taken_away(
    user: Client, tmp_path: Path
) -> None:
    program = tmp_path / "guard.py"
    program.write_text(_GUARD)
    tests = Path(__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": f"{tests.parent}{os.pathsep}{tests}"}
    for words in (["checks"], []):
        with subprocess.Popen([sys.executable, program, *words], stdin=subprocess.PIPE, env=environment) as process:
            until(lambda: "guard" in {one["module"] for one in user.status("modules")}, "the program is there")
            until(lambda: "later" in listed("wiretaps"), "it has attached something")
            if not words:
                until(stale, "the program is said to be ready")
                text = tca(attached)[1]
                assert stale() == ["say move"]
                check = listed("wiretaps")["say move"]["id"]
                assert [line.split()[0] for line in text.splitlines() if "guard (an earlier run)" in line] == [
                    str(check)
                ]
                gone = f"wiretap say move {{{check}}} of all move, which 'guard' had attached in an earlier run: detached\n"
                assert tca(detach, "--stale") == (0, gone, "")
                assert [*listed("wiretaps")] == ["later"]
                assert tca(detach, "--stale") == (0, "nothing is left of earlier runs\n", "")
            process.communicate(timeout=SOON)
        until(lambda: "guard" not in {one["module"] for one in user.status("modules")}, "the program has ended")
        assert stale() == []  # a program that is not there may yet come back as it was


def test_exception_handlers_and_monitors_of_an_earlier_run_are_stale_too(address: str, user: Client) -> None:
    first = Module("guard", address)

    @first.at_start
    def _attach_all(guard: Module) -> None:
        guard.on_failure(FELL, FIX, of=WALK)
        guard.on_failure(None, FIX)
        guard.monitor(LOOK, period=9.0, waited_for=True)

    with first.running():
        pass
    second, early = Module("guard", address), list[str]()
    second.at_start(lambda _: early.extend(stale()))
    second.at_start(lambda guard: guard.on_failure(FELL, FIX, of=WALK))
    with second.running():
        assert early == []  # it may attach more
        known = json.loads(tca(attached, "--json")[1])
        found = [(one["task"], one["message"], one["is_stale"]) for one in known["exception_handlers"]]
        assert found == [(0, "", True), (0, "walk", False)]
        assert known["exception_handlers"][0]["earlier"] == ["guard"]
        assert known["exception_handlers"][0]["gone"] == []
        assert listed("monitors")["look"]["is_stale"]
        code, text, _ = tca(detach, "--stale")
        assert (code, text.count("detached"), stale()) == (0, 2, [])


def test_what_hangs_at_a_task_ends_with_it_and_is_not_stale(address: str, user: Client) -> None:
    user.goal(WALK, 1)
    with Module("guard", address).running() as guard:
        (walk,) = guard.tasks(WALK)
        guard.tap(Condition.AFTER_HANDLED, walk, LATER)
    with Module("guard", address).running():
        assert listed("wiretaps")["later"]["earlier"] == ["guard"]
        assert stale() == []


def test_what_another_run_or_program_holds_is_not_stale(address: str, user: Client) -> None:
    user.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
    with Module("guard", address).running() as guard, Module("guard", address).running():
        guard.on_failure(FELL, FIX, of=WALK)
        guard.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
        assert stale() == []
        with Module("guard", address).running() as third:  # a copy attaches the same, and leaves
            third.on_failure(FELL, FIX, of=WALK)
            third.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
            third.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
        assert stale() == []
        assert listed("wiretaps")["say move"]["modules"] == ["guard", "guard#3"]
        assert listed("wiretaps")["later"]["earlier"] == ["guard#3"]  # the user has it, too


def test_scripts_of_one_name_leave_what_they_have_attached(address: str) -> None:
    with connect("script", address) as script:
        script.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
    with connect("script", address) as script:
        script.declared("move")
        assert listed("wiretaps")["later"]["gone"] == ["script"]
        assert stale() == []


def test_stale_goes_without_a_name(user: Client) -> None:
    assert tca(detach, "--stale", "later")[0] == 2
    assert tca(detach)[0] == 2

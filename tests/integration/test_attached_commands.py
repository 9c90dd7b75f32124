"""Exception handlers, wiretaps and monitors are listed and detached, by any module."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from integration.commanded import FELL, FIX, LATER, LOOK, MOVE, SAY_MOVE, SOON, WALK, tca
from module.real_central import RealCentral, until
from processes import Process

from tca_module import Client, Condition, Module, Refused, connect
from tca_tools.live.questions import attached
from tca_tools.live.tasks import detach
from tca_wire.journal import facts

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("find_central")]


def test_attached_command_lists_handlers_wiretaps_and_monitors(
    robot: list[str], user: Client
) -> None:
    assert tca(attached) == (0, "no exception handlers, wiretaps or monitors\n", "")
    walk = user.goal(WALK, 1)
    fell = user.on_failure(FELL, FIX, of=WALK, maximum=2)
    user.on_failure(None, FIX)
    walk.on_failure(FELL, FIX)
    with connect("other script") as other:
        other.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
        user.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
        user.tap(Condition.WHILE_HANDLING, walk, LOOK, period=1.0)
        look = other.under(walk).monitor(LOOK, period=9.0)
        code, text, _ = tca(attached)
        report = json.loads(tca(attached, "--json")[1])
    fields = [re.split(r" {2,}", line.strip()) for line in text.splitlines()]
    assert (code, fields[1][0]) == (0, str(fell.id))
    assert [words[1:] for words in fields[1:4]] == [
        ["fell", "all walk", "fix", "2", "user", "-"],
        ["any failure", "the root", "fix", "user", "-"],
        ["fell", f"walk {{{walk.id}}}", "fix", "user", "-"],
    ]
    assert [words[1:] for words in fields[6:8]] == [
        ["before handling", "all move", "later", "other script, user", "-"],
        ["while handling", f"walk {{{walk.id}}}", "look", "user", "central"],
    ]
    assert fields[9:] == [
        ["number", "monitor", "under", "sent by"],
        [str(look.id), "look", f"walk {{{walk.id}}}", "other script"],
    ]
    first = {
        "id": fell.id,
        "failure": "fell",
        "handler": "fix",
        "task": 0,
        "message": "walk",
        "maximum": 2,
    }
    assert report["exception_handlers"][0] == {
        **first,
        "modules": ["user"],
        "gone": [],
        "earlier": [],
        "is_stale": False,
        "handled_by": [],
    }
    assert [one["task"] for one in report["wiretaps"]] == [0, walk.id]
    text = tca(attached)[1]
    assert "other script (has left), user" in text
    assert text.count("(has left)") == 2
    fell.remove()
    left = user.status("attached")
    assert len(left["exception_handlers"]) == 2
    assert left["wiretaps"][0]["modules"] == [
        "other script",
        "user",
    ]  # also when one of them has left


def test_monitor_beyond_listing_limit_is_detached_by_number(
    robot: list[str], user: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tca_central.status.topics.SHOWN_TASKS", 20)
    first = user.monitor(LOOK, period=1000.0)
    refs = [user.monitor(LOOK, period=1000.0) for _ in range(20)]
    user.status("attached")  # a request on another connection might overtake the monitors
    text = tca(attached)[1]
    numbers = [int(line.split()[0]) for line in text.splitlines() if "look" in line]
    assert numbers == [first.id, *(ref.id for ref in refs[:-1])]
    assert text.endswith("only the first are listed: there are 21 monitors\n")
    assert tca(detach, "look")[2].startswith("there are 21 monitors, and central names only")
    last = refs[-1].id
    assert tca(detach, str(last))[:2] == (0, f"number {last}: detached\n")
    assert first.id in [one["id"] for one in user.status("attached")["monitors"]]


def test_detach_removes_attachments_of_a_disconnected_module(
    robot: list[str], user: Client, daemon: RealCentral
) -> None:
    walk = user.goal(WALK, 1)
    walk.wait_for(walk.handling.end, SOON)
    with connect("panel") as panel:
        of_all, of_one = panel.on_failure(FELL, FIX, of=WALK), panel.on_failure(FELL, FIX, of=walk)
        check = panel.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
        watched = panel.tap(Condition.WHILE_ACHIEVING, WALK, LOOK, period=9.0)
        look = panel.under(walk).monitor(LOOK, period=9.0)
    user.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
    both = [
        f"exception handler fix {{{of_all.id}}} of all walk",
        f"exception handler fix {{{of_one.id}}} of walk {{{walk.id}}}",
    ]
    text = f"2 of that name are attached: give the number of one, {' and '.join(both)}: see 'tca attached'\n"
    assert tca(detach, "fix") == (1, "", text)
    assert tca(detach, str(of_all.id)) == (0, both[0] + ": detached\n", "")
    assert tca(detach, "fix") == (0, both[1] + ": detached\n", "")
    assert tca(detach, "say move")[:2] == (
        0,
        f"wiretap say move {{{check.id}}} of all move: detached\n",
    )
    assert tca(detach, str(look.id))[:2] == (
        0,
        f"monitor look {{{look.id}}} of walk {{{walk.id}}}: detached\n",
    )
    there = f"attached are wiretap look {{{watched.id}}} of all walk: see 'tca attached'\n"
    for what, why in (
        (str(check.id), f"{check.id} is not attached, or was removed"),
        ("9999", "there is no number 9999 yet"),
        (str(walk.id), f"walk {{{walk.id}}} is not attached: 'tca kill {walk.id}' ends it"),
        ("fxi", "nothing called 'fxi' is attached"),
        ("0", "0 is not attached, or was removed"),
    ):
        assert tca(detach, what) == (1, "", f"{why}; {there}")
    assert user.detach(watched.id)
    assert not user.detach(watched.id)
    assert tca(detach, "look") == (
        1,
        "",
        "nothing called 'look' is attached; there are no attachments\n",
    )
    with pytest.raises(Refused, match="is a goal, which is not attached: kill it to end it"):
        user.detach(walk.id)
    with pytest.raises(Refused, match=r"no exception handler or wiretap \{9999\}"):
        user.detach(9999)
    gone = daemon.facts(facts.Removed)
    numbers = [of_all.id, of_one.id, check.id, watched.id]
    assert [(fact.id, fact.by) for fact in gone] == list(
        zip(numbers, ["tca detach"] * 3 + ["user"], strict=True)
    )


# --- attachments that a restarted program does not make again are stale -----------------------------


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


def attachments(kind: str) -> dict[str, dict[str, Any]]:
    """Return all attachments of a kind, by the name of the listener or handler."""
    name = {"exception_handlers": "handler", "wiretaps": "listener", "monitors": "monitor"}[kind]
    return {one[name]: one for one in json.loads(tca(attached, "--json")[1])[kind]}


def stale_names() -> list[str]:
    return [
        name
        for kind in ("exception_handlers", "wiretaps", "monitors")
        for name, one in attachments(kind).items()
        if one["is_stale"]
    ]


def test_wiretap_missing_from_edited_program_is_stale(user: Client, tmp_path: Path) -> None:
    program = tmp_path / "guard.py"
    program.write_text(_GUARD)
    for words in (["checks"], []):
        with Process(str(program), *words) as process:
            until(
                lambda: "guard" in {one["module"] for one in user.status("modules")},
                "the program is there",
            )
            until(lambda: "later" in attachments("wiretaps"), "it has attached something")
            if not words:
                until(stale_names, "the program is said to be ready")
                text = tca(attached)[1]
                assert stale_names() == ["say move"]
                check = attachments("wiretaps")["say move"]["id"]
                assert [
                    line.split()[0]
                    for line in text.splitlines()
                    if "guard (an earlier run)" in line
                ] == [str(check)]
                gone = f"wiretap say move {{{check}}} of all move, which 'guard' had attached in an earlier run: detached\n"
                assert tca(detach, "--stale") == (0, gone, "")
                assert [*attachments("wiretaps")] == ["later"]
                assert tca(detach, "--stale") == (0, "nothing is left from earlier runs\n", "")
            process.communicate(timeout=SOON)
        until(
            lambda: "guard" not in {one["module"] for one in user.status("modules")},
            "the program has ended",
        )
        assert stale_names() == []  # an absent program may still return unchanged


def test_handlers_and_monitors_of_earlier_run_are_stale(address: str, user: Client) -> None:
    first = Module("guard", address)

    @first.at_start
    def _attach_all(guard: Module) -> None:
        guard.on_failure(FELL, FIX, of=WALK)
        guard.on_failure(None, FIX)
        guard.monitor(LOOK, period=9.0, waited_for=True)

    with first.running():
        pass
    second, early = Module("guard", address), list[str]()
    second.at_start(lambda _: early.extend(stale_names()))
    second.at_start(lambda guard: guard.on_failure(FELL, FIX, of=WALK))
    with second.running():
        assert early == []  # the second module may still attach more
        known = json.loads(tca(attached, "--json")[1])
        found = [
            (one["task"], one["message"], one["is_stale"]) for one in known["exception_handlers"]
        ]
        assert found == [(0, "", True), (0, "walk", False)]
        assert known["exception_handlers"][0]["earlier"] == ["guard"]
        assert known["exception_handlers"][0]["gone"] == []
        assert attachments("monitors")["look"]["is_stale"]
        code, text, _ = tca(detach, "--stale")
        assert (code, text.count("detached"), stale_names()) == (0, 2, [])


def test_wiretap_on_one_task_is_not_stale(address: str, user: Client) -> None:
    user.goal(WALK, 1)
    with Module("guard", address).running() as guard:
        (walk,) = guard.tasks(WALK)
        guard.tap(Condition.AFTER_HANDLED, walk, LATER)
    with Module("guard", address).running():
        assert attachments("wiretaps")["later"]["earlier"] == ["guard"]
        assert stale_names() == []


def test_attachment_shared_with_another_module_is_not_stale(address: str, user: Client) -> None:
    user.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
    with Module("guard", address).running() as guard, Module("guard", address).running():
        guard.on_failure(FELL, FIX, of=WALK)
        guard.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
        assert stale_names() == []
        with Module("guard", address).running() as third:  # attaches the same, and leaves
            third.on_failure(FELL, FIX, of=WALK)
            third.tap(Condition.BEFORE_HANDLING, MOVE, SAY_MOVE)
            third.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
        assert stale_names() == []
        assert attachments("wiretaps")["say move"]["modules"] == ["guard", "guard#3"]
        assert attachments("wiretaps")["later"]["earlier"] == ["guard#3"]  # shared with the user


def test_attachment_of_an_earlier_script_is_not_stale(address: str) -> None:
    with connect("script", address) as script:
        script.tap(Condition.BEFORE_HANDLING, MOVE, LATER)
    with connect("script", address) as script:
        script.declared("move")
        assert attachments("wiretaps")["later"]["gone"] == ["script"]
        assert stale_names() == []


def test_detach_rejects_stale_with_a_name_and_neither(user: Client) -> None:
    assert tca(detach, "--stale", "later")[0] == 2
    assert tca(detach)[0] == 2

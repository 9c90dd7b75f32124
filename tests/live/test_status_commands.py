"""``tca status``, ``modules``, ``messages`` and ``variables`` with a running central."""

import json
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from module.real_central import RealCentral
from module.robot import MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall

from tca_module import Module, Variable, connect
from tca_tools.live import questions as commands
from tca_wire.text.measures import duration

SOON = 10.0


@pytest.fixture
def address(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}/central.sock"


@pytest.fixture
def central(address: str) -> Iterator[str]:
    """Run a central, and yield its address."""
    with RealCentral(address):
        yield address


def ask(command: click.Command, *arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(command, arguments)
    return result.exit_code, result.output


def test_status_says_what_waits_for_what(central: str) -> None:
    legs, go = Module("legs", central), threading.Event()
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, float(go.wait(SOON))))
    with legs.running(), connect("user", central) as user:
        user.query_send(TEMPERATURE)
        first = user.goal(REST)
        user.goal(REST, sequential_planning=True)
        for leg in range(2):
            user.command(MOVE_LEG, leg, sequential=False)
        code, text = ask(commands.status, "--central", central)
        assert code == 0
        assert text.startswith(f"central at {central}, run real\n")
        assert "4 tasks" in text
        lines = [" ".join(line.split()) for line in text.splitlines()]
        assert "waiting for" in lines
        assert "temperature {1} for a module that handles temperature" in lines
        assert f"rest {{{first.id + 1}}} until rest {{{first.id}}} is planned" in lines, text
        assert "1 held task waits in the end for a module that handles rest" in lines
        assert (
            f"move leg {{{first.id + 3}}} for legs, busy with move leg {{{first.id + 2}}}" in lines
        )
        code, text = ask(commands.status, "--central", central, "--json")
        waiter = json.loads(text)["waiting"][0]
        assert waiter.pop("seconds") > 0
        assert waiter == {
            "what": "temperature {1}",
            "for": "for a module that handles temperature",
            "state": "waits",
            "number": 1,
            "name": "temperature",
            "waits": [{"kind": "handler", "name": "temperature"}],
        }
        go.set()


def test_status_names_the_task_to_resume(central: str) -> None:
    planner, steps = Module("planner", central), []
    planner.handles(REST)(lambda task: steps.append(task.command(MOVE_LEG, 1)))
    with planner.running(), connect("user", central) as user:
        rest = user.goal(REST)
        rest.wait_for(rest.handling.end, SOON)
        rest.suspend()
        status = json.loads(ask(commands.status, "--central", central, "--json")[1])
        (held,) = [one for one in status["waiting"] if one["state"] == "held"]
        assert (held["number"], held["waits"][0]["number"]) == (steps[0].id, rest.id)
        ago = duration(status["time"] - held["waits"][0]["seconds"])
        assert f"is resumed (suspended by user {ago} ago)" in held["for"]
        assert held["for"].endswith(f": 'tca resume {rest.id}'")


def test_status_says_that_a_task_was_created_suspended(central: str) -> None:
    with connect("planner", central) as planner:
        rest = planner.goal(REST, suspended=True)
        text = " ".join(ask(commands.status, "--central", central)[1].split())
        assert "until it is resumed (suspended since its creation by planner" in text, text
        assert f"'tca resume {rest.id}'" in text


def test_status_says_what_it_did_not_inspect(central: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tca_central.status.load.LOOKED_AT", 40)
    with connect("user", central) as user:
        for _ in range(60):
            user.goal(REST, sequential_planning=True)
        lines = ask(commands.status, "--central", central)[1].splitlines()
    assert lines[-4:] == [
        "... and at least 20 more",
        "",
        "at least 39 held tasks wait in the end for a module that handles rest",
        "only the 40 oldest tasks were searched for held ones",
    ]


def test_status_names_messages_that_wait_for_a_handler(central: str) -> None:
    planner = Module("planner", central, requires=[TEMPERATURE, STANCE])
    starting = threading.Thread(target=planner.run)
    starting.start()
    with connect("user", central) as user:
        user.wait_until_handled(timeout=SOON)
        while not any(message["awaited_by"] for message in user.status("messages")):
            user.status()
        lines = [
            " ".join(line.split())
            for line in ask(commands.status, "--central", central)[1].splitlines()
        ]
        assert "module planner for a module that handles temperature and stance" in lines
    planner.stop()
    starting.join(SOON)


def test_status_lists_modules_and_messages(central: str) -> None:
    legs = Module("legs", central)
    assert ask(commands.modules, "--central", central) == (0, "no modules are connected\n")
    assert ask(commands.messages, "--central", central) == (0, "no messages have been declared\n")
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))
    with legs.running(), connect("user", central) as user:
        user.query_send(TEMPERATURE)
        user.status()
        code, text = ask(commands.modules, "--central", central)
        heads, first, second = text.splitlines()
        assert heads.split() == [
            "module",
            "process",
            "resource",
            "capacity",
            "handling",
            "waiting",
            "handles",
        ]
        assert {first.split()[0], second.split()[0]} == {"legs", "user"}
        assert "legs      1         -                  move leg" in text
        code, text = ask(commands.messages, "--central", central)
        assert code == 0
        assert text == (
            "message      class    handled by  waiting\n"
            "move leg     command  legs\n"
            "temperature  query    -           1\n"
        )
        names = [
            module["module"]
            for module in json.loads(ask(commands.modules, "--central", central, "--json")[1])
        ]
        assert sorted(names) == ["legs", "user"]


def test_status_lists_variables(central: str) -> None:
    assert ask(commands.variables, "--central", central) == (0, "no variables have been declared\n")
    legs = Module("legs", central)
    legs.handles(Variable("pose", Footfall))(lambda *_: None)
    with legs.running(), connect("user", central) as user:
        user.set_variable(Variable("mode", str), "walking")
        user.set_variable(Variable("map", list[int]), list(range(500)))
        code, text = ask(commands.variables, "--central", central)
        assert code == 0
        assert text == (
            "variable  value         set by  watched by\n"
            "map       (1119 bytes)  user    -\n"
            'mode      "walking"     user    -\n'
            "pose      (never set)   -       legs\n"
        )
        data = json.loads(ask(commands.variables, "--central", central, "--json")[1])
        assert [variable["value"] for variable in data] == [None, "walking", None]


def test_values_outside_json_are_printed(central: str) -> None:
    with connect("user", central) as user:
        user.set_variable(Variable("when", datetime), datetime(2024, 2, 3, tzinfo=UTC))
        user.set_variable(Variable("raw", bytes), b"\x00")
        data = json.loads(ask(commands.variables, "--central", central, "--json")[1])
        assert [variable["value"] for variable in data] == ["AA==", "2024-02-03T00:00:00Z"]


def test_command_prints_one_line_without_central(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tca_tools.live.shared._PATIENCE", 0.2)
    code, text = ask(commands.status, "--central", address)
    assert code == 1
    assert text.splitlines() == [
        f"Error: central at {address} does not answer: start it with 'tca central', or set $TCA_CENTRAL to where it listens"
    ]
    code, text = ask(commands.status, "--central", "somewhere")
    assert code == 2
    assert "not 'somewhere'" in text

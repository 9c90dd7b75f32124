"""Commands that change a running central: tasks, messages and variables."""

import json
import re
import threading

import pytest
from integration.commanded import (
    FELL,
    FIX,
    LATER,
    LOOK,
    MODE,
    POSE,
    SAY,
    SILENT,
    SOON,
    TICK,
    WALK,
    WHERE,
    Pose,
    tca,
)

from tca_central.order import dispatcher
from tca_module import Client, Failure, Module, MultiQuery, Outcome, Task, connect
from tca_tools.live.messages import get_variable, query, send, set_variable
from tca_tools.live.questions import modules, status
from tca_tools.live.tasks import kill, raise_failure, resume, retry, suspend, unlock

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("find_central")]


def test_send_prints_the_task_number(robot: list[str], user: Client) -> None:
    code, text, _ = tca(send, "walk", "1")
    task = user.tasks("walk")[0]
    assert (code, text) == (0, f"walk {{{task.id}}}\n")
    assert tca(send, "walk", "1", "--json")[:2] == (
        0,
        f'{{\n "task": {user.tasks(WALK)[1].id}\n}}\n',
    )


def test_send_wait_prints_the_task_result(robot: list[str]) -> None:
    code, text, _ = tca(send, "move", "leg=1", "to.x=2", "to.y=0", "--wait")
    assert code == 0
    assert text.splitlines()[1] == 'done: {"x": 2.0, "y": 0.0}'
    code, text, _ = tca(send, "move", '{"leg": 1, "to": {"x": 2, "y": 3}}', "--wait", "--json")
    report = json.loads(text)
    assert (code, report["outcome"], report["result"]) == (0, "done", {"x": 2.0, "y": 3.0})
    assert tca(send, "move", "-", "--wait", given='{"leg": 1, "to": {"x": 1}}')[0] == 0
    assert tca(send, "walk", "0", "--wait")[1].endswith("}\ndone\n")


def test_send_wait_exits_1_when_task_fails_or_is_killed(robot: list[str], user: Client) -> None:
    code, text, error = tca(send, "walk", "--wait", "--", "-1")
    assert (code, error) == (1, f"{text.strip()} failed: fell: too\n")
    code, text, _ = tca(send, "walk", "--wait", "--json", "--", "-1")
    report = json.loads(text)
    assert (code, report["outcome"], report["failure"], report["data"]) == (1, "failed", "fell", -1)
    killed: list[tuple[int, str, str]] = []
    waiting = threading.Thread(target=lambda: killed.append(tca(send, "later", "--wait")))
    user.execute_if_handled(LATER)
    waiting.start()
    while not (found := user.tasks("later")):
        user.modules()
    found[0].kill("enough")
    waiting.join(SOON)
    assert killed[0][0] == 1
    assert killed[0][2].endswith(f"later {{{found[0].id}}} was killed: enough (by user)\n")


def test_send_is_refused_when_the_queue_is_full(
    user: Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 2)
    user.inform(SAY, "one", wait=0)
    user.inform(SAY, "two", wait=0)
    code, _, error = tca(send, "say", "three")
    assert (code, error.splitlines()[-1].partition(",")[0]) == (
        1,
        "inform 'say' was refused: 2 messages wait for a module that handles say",
    )
    assert error.endswith("first in line; from 2 on no more are let in: try later\n")
    for _ in range(3):
        user.inform(SAY, "lost")
    user.modules()
    _, shown, _ = tca(status)
    assert "dropped: 3 of say" in shown
    assert any(line.startswith("dropped 'say': 2 messages wait") for line in caplog.messages)


def test_send_timeout_leaves_the_task_running(robot: list[str], user: Client) -> None:
    code, text, error = tca(send, "walk", "1", "--timeout", "0.1")
    task = user.tasks("walk")[0].id
    assert (code, text) == (1, f"walk {{{task}}}\n")
    assert (
        error
        == f"walk {{{task}}} has not ended within 0.1 s, and continues: 'tca kill {task}' ends it\n"
    )


def test_send_returns_after_central_received_the_inform(robot: list[str], user: Client) -> None:
    for word, heard in (
        ("hello", "hello"),
        ("5", "5"),
        ("a=b", "a=b"),
        ('"quoted"', "quoted"),
        ("null", "null"),
    ):
        assert tca(send, "say", word) == (0, "", "")
        user.query(WHERE, Pose(0.0), timeout=SOON)  # one thread: all earlier messages are handled
        assert robot.pop() == heard
    assert tca(send, "tick") == (0, "", "")


def test_send_warns_about_an_unhandled_message(user: Client) -> None:
    user.execute_if_handled(LATER)
    user.execute_if_handled(TICK)
    code, _, error = tca(send, "later")
    assert (code, error) == (
        0,
        "command 'later' has no handler now: it waits for one\n",
    )
    assert tca(send, "tick")[2] == "broadcast 'tick' has no handler now: it reaches no module\n"


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (["walkk", "3"], 1, "no module has declared a message 'walkk': did you mean 'walk'?"),
        (["xyz"], 1, "no module has declared a message 'xyz': see 'tca messages', and start the module that declares it"),
        (["walk"], 2, "goal 'walk' wants data (integer), but none were given"),
        (["walk", "five"], 2, "goal 'walk' wants data of type integer: the data must be a whole number, not \"five\""),
        (["walk", "3", "4"], 2, "goal 'walk' takes one value (integer), but 2 were given"),
        (["move", "leg=1"], 2, "command 'move' wants data of type Move: field 'to' is missing: it must be an object with x, y"),
        (["move", "leg=1", "to.z=1", "to.x=1"], 2, "command 'move' wants data of type Move: field 'to.z' is unknown: the fields are x, y"),
        (["move", "leg=1", "leg=2"], 2, "field 'leg' is given twice: give it once"),
        (["move", "to={}", "to.x=2"], 2, "fields 'to.x' and 'to' exclude each other: give one of them"),
        (["move", "leg=1", "x"], 2, "'x' is not a field of command 'move': write key=value"),
        (["move", "-"], 2, "the standard input is not JSON: Expecting value: line 1 column 1 (char 0)"),
        (["tick", "5"], 2, "broadcast 'tick' takes no data, but '5' was given"),
        (["tick", "--wait"], 2, "broadcast 'tick' has no end to wait for: leave out --wait and --timeout"),
        (["mode", "x"], 2, "variable 'mode' is not sent: set it with 'tca set'"),
        (["fix", "1"], 2, "exception handler 'fix' is not sent: raise its failure with 'tca raise'"),
        (["look"], 2, "'look' is a polling monitor: declare it in Python to start it"),
        (["say", "\udcff"], 2, "inform 'say' wants data of type string: 'utf-8' codec can't encode character '\\udcff' in position 0: surrogates not allowed"),
    ],
)  # fmt: skip
def test_send_rejects_invalid_message(
    robot: list[str], user: Client, words: list[str], code: int, error: str
) -> None:
    user.on_failure(FELL, FIX)
    user.get_variable(MODE, None)
    user.monitor(LOOK, period=60).kill()
    before = user.status()["newest id"]
    assert tca(send, *words) == (code, "", error + "\n")
    assert user.status()["newest id"] == before


def test_query_prints_the_reply(robot: list[str]) -> None:
    for command in (query, send):
        assert tca(command, "where", "x=1", "y=2.5") == (0, '{"x": 2.0, "y": 2.5}\n', "")
    code, text, _ = tca(query, "where", "x=1", "--json")
    assert (code, json.loads(text)) == (0, {"x": 2.0, "y": 0.0})


def test_query_prints_each_reply_of_a_multi_query(robot: list[str]) -> None:
    assert tca(query, "health") == (0, "0.5\n0.5\n", "")
    assert tca(query, "health", "--maximum", "1") == (0, "0.5\n", "")
    assert json.loads(tca(query, "health", "--json")[1]) == [0.5, 0.5]


def test_query_without_reply_exits_with_the_reason(robot: list[str], user: Client) -> None:
    for message in (SILENT, MultiQuery("nobody", reply=int)):
        user.execute_if_handled(message)
    code, text, error = tca(query, "silent", "--timeout", "0.1")
    assert (code, text) == (1, "")
    why = "no module handles it; to wait longer, give --timeout"
    assert error.endswith(f"query 'silent' was not answered within 0.1 s: {why}\n")
    assert tca(query, "nobody")[0] == 1
    assert tca(query, "walk", "1") == (
        2,
        "",
        "goal 'walk' is not a query: send it with 'tca send'\n",
    )
    assert tca(query, "where", "x=1", "--maximum", "2")[0] == 2


def test_set_and_get_commands_handle_variables(user: Client) -> None:
    for variable in (MODE, POSE):
        user.get_variable(variable, None)
    assert tca(get_variable, "mode") == (
        1,
        "",
        "variable 'mode' was never set: set it with 'tca set', or start the module that sets it\n",
    )
    assert tca(set_variable, "mode", "walking") == (0, "", "")
    assert user.get_variable(MODE) == "walking"
    assert tca(get_variable, "mode") == (0, "walking\n", "")
    assert tca(set_variable, "pose", "x=1") == (0, "", "")
    assert user.get_variable(POSE) == Pose(1.0, 0.0)
    assert tca(get_variable, "pose", "--json") == (0, '{\n "x": 1.0\n}\n', "")
    assert tca(set_variable, "pose", "z=1")[0] == 2
    assert tca(get_variable, "walk")[:2] == (1, "")


def test_kill_command_accepts_task_number_or_name(
    robot: list[str], user: Client, address: str
) -> None:
    one, other = user.goal(WALK, 1), user.goal(WALK, 2)
    other.wait_for(other.handling.end, SOON)
    code, _, error = tca(kill, "walk")
    assert (code, error) == (
        1,
        f"2 living tasks are called 'walk': give the number of one, {one.id} and {other.id}\n",
    )
    assert tca(kill, str(one.id), "--why", "enough") == (0, f"walk {{{one.id}}}: killed\n", "")
    assert tca(kill, "walk", "--descendants") == (0, f"all under walk {{{other.id}}}: killed\n", "")
    assert one.wait(SOON) is Outcome.KILLED
    assert other.wait(SOON) is Outcome.DONE
    assert tca(kill, str(one.id)) == (
        1,
        "",
        f"task {{{one.id}}} has ended: 'tca tree' shows how, given the journal of {address} as LOG\n",
    )
    assert tca(kill, "walk") == (
        1,
        "",
        f"no living task is called 'walk': central at {address} has no living tasks\n",
    )
    rest = user.goal(WALK, 1)
    assert tca(kill, "work")[2].startswith(
        f"no living task is called 'work': living tasks are walk {{{rest.id}}}"
    )


def test_kill_command_supports_siblings_and_delay(robot: list[str], user: Client) -> None:
    one, other = user.goal(WALK, 1), user.goal(WALK, 1)
    assert tca(kill, str(one.id), "--siblings") == (
        0,
        f"the siblings of walk {{{one.id}}}: killed\n",
        "",
    )
    assert other.wait(SOON) is Outcome.KILLED
    assert tca(kill, "walk", "--in", "0.05") == (
        0,
        f"walk {{{one.id}}}: to be killed in 0.05 s\n",
        "",
    )
    assert one.wait(SOON) is Outcome.KILLED


def test_suspend_and_resume_commands_report_task_state(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    for command, state in (
        (suspend, "suspended"),
        (suspend, "suspended already"),
        (resume, "resumed"),
        (resume, "not suspended"),
    ):
        assert tca(command, "walk") == (0, f"walk {{{walk.id}}}: {state}\n", "")


def test_retry_command_restarts_the_task(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    while not (before := walk.children()):
        user.modules()
    code, text, error = tca(retry, "walk")
    assert (code, text.startswith(f"walk {{{walk.id}}}: to be handled again"), error) == (
        0,
        True,
        "",
    )
    while not (after := walk.children()) or after[0].id == before[0].id:
        user.modules()
    assert len(after) == 1


def test_status_command_lists_suspended_tasks(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    walk.wait_for(walk.handling.end, SOON)
    walk.suspend()
    (report,) = [
        one
        for one in json.loads(tca(status, "--json")[1])["waiting"]
        if one["state"] == "suspended"
    ]
    assert report["what"] == f"walk {{{walk.id}}}"
    assert re.fullmatch(
        rf"until it is resumed \(suspended by user .+ [mµ]?s ago\): 'tca resume {walk.id}'",
        report["for"],
    )
    assert not re.search(
        r"\b1 (\w+ )*\w+s(,|$)", tca(status)[1].partition("\n\n")[0], re.MULTILINE
    )  # such as "1 tasks"
    walk.resume()
    assert "suspended" not in tca(status)[1]
    tca(suspend, "walk")
    assert re.search(r"suspended by the command 'tca suspend' .+s ago\): ", tca(status)[1])


def test_status_command_does_not_count_its_own_connection(user: Client) -> None:
    report = json.loads(tca(status, "--json")[1])
    assert (report["modules"], report["connections"]) == (1, 1)  # the user
    assert "1 module, 1 connection," in tca(status)[1]
    user.close()
    assert "0 modules, 0 connections," in tca(status)[1]


def test_unlock_command_releases_the_lock(robot: list[str], user: Client) -> None:
    user.lock("other")
    code, shown, _ = tca(modules)
    assert (code, "locked by user" in shown) == (0, True)
    with connect("waiting") as waiting:
        with pytest.raises(Exception, match="which user has locked"):
            waiting.lock("other", timeout=0)
        assert tca(unlock, "other") == (0, "resource 'other': free again\n", "")
        assert tca(unlock, "other", "--module", "other") == (
            0,
            "resource 'other': it had no holder\n",
            "",
        )
        waiting.lock("other", timeout=0)
    assert tca(unlock, "arm") == (
        1,
        "",
        "unlocking resource 'arm' was refused: no module has a resource 'arm': see 'tca modules'\n",
    )


def test_raise_command_fails_the_task(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    report = tca(raise_failure, "walk", "fell", "it slipped", "--data", "7")
    assert report == (0, f"walk {{{walk.id}}}: failure 'fell' was raised\n", "")
    with pytest.raises(Exception, match="fell: it slipped") as failed:
        walk.result(SOON)
    assert failed.value.data_as(FELL) == 7  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("task", "code", "error"),
    [
        (
            "0",
            1,
            "task {0} is the root, which never ends: give the number of a task; central at ADDRESS has no living tasks",
        ),
        ("999", 1, "there is no task {999}: central at ADDRESS has no living tasks"),
        ("9" * 30, 2, f"task(): task_id must be a number, as in the journal, not {'9' * 30}"),
        ("nobody", 1, "no living task is called 'nobody': central at ADDRESS has no living tasks"),
        ("", 2, "'' is not a task: give the number of a task, or its message's name"),
        ("\udcff", 2, "'\\udcff' is not a task: give the number of a task, or its message's name"),
    ],
)
def test_task_command_rejects_invalid_task(address: str, task: str, code: int, error: str) -> None:
    for command, words in (
        (kill, ()),
        (suspend, ()),
        (resume, ()),
        (retry, ()),
        (raise_failure, ("fell",)),
    ):
        assert tca(command, task, *words) == (code, "", error.replace("ADDRESS", address) + "\n")


def test_task_commands_reject_invalid_options(robot: list[str], user: Client) -> None:
    walk = user.goal(WALK, 1)
    assert tca(kill, "walk", "--in", "1e300")[0] == 2
    assert tca(kill, "walk", "--in", "-1")[0] == 2
    assert "not nan" in tca(kill, "walk", "--in", "nan")[2]
    assert "one after the other" in tca(kill, "walk", "--siblings", "--descendants")[2]
    assert "not nan" in tca(query, "where", "x=1", "--timeout", "nan")[2]
    assert tca(raise_failure, "walk", "a\nb")[0] == 2
    assert walk.info() is not None


def test_failure_name_with_colons_is_reported_whole(user: Client, address: str) -> None:
    stuck, legs = Failure("knee: stuck: hard"), Module("legs", address)

    @legs.handles(LATER)
    def later(_: Task) -> None:
        raise stuck(text="a screw: loose")

    with legs.running():
        assert "knee: stuck: hard: a screw: loose\n" in tca(send, "later", "--wait")[2]
        assert (
            json.loads(tca(send, "later", "--wait", "--json")[1])["failure"] == "knee: stuck: hard"
        )
    task = user.command(LATER)
    report = tca(raise_failure, "later", "knee: stuck: hard", "by hand")
    assert report == (0, f"later {{{task.id}}}: failure 'knee: stuck: hard' was raised\n", "")

"""The server of the page, with requests from a program."""

import json
import re
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from processes import Process
from tools.story import stumbling, walking

from tca_tools.view.__main__ import view
from view.frames import parsed

pytestmark = pytest.mark.slow


def get(address: str, headers: dict[str, str] | None = None) -> Any:
    with urllib.request.urlopen(
        urllib.request.Request(address, headers=headers or {}), timeout=20
    ) as answer:
        return answer.read()


@pytest.fixture
def address(serve: Callable[[Path], str], tmp_path: Path) -> str:
    return serve(stumbling().write(tmp_path / "walk"))


def asked(address: str, what: str) -> Any:
    return json.loads(get(f"{address}api/{what}"))


END = "in the end for move leg {6}, which controller handles"


def test_server_gives_all_details_of_a_task(address: str) -> None:
    get(f"{address}api/frame")
    details = asked(address, "message/7?at=2.5")
    waits = [{"text": "waits until move leg {6} is achieved", "since": 1.4}]
    assert (details["state"], details["waits"], details["end"]) == ("held", waits, "")
    details = asked(address, "message/7")
    assert (details["state"], details["waits"]) == ("failed", [])
    assert details["failure"] == r"terrain collision: leg 4 met\x1b[31m rock"
    assert details["story"][-2] == {
        "time": 4.5,
        "text": f"failed: {details['failure']}",
        "seconds": None,
        "isOpen": False,
    }
    assert asked(address, "message/4?at=1")["constraints"] == [
        {"text": "start achieving not before take steps {3} end achieving", "isMet": False},
        {"text": "start planning not before take steps {3} start achieving", "isMet": False},
    ]
    details = asked(address, "message/5")
    assert (details["name"], details["class"], "state" in details) == (
        "elevation map",
        "query",
        False,
    )
    assert details["relations"] == [["sent by", "gait planner while handling take steps {2}"]]


def test_server_gives_notes_and_messages_around_a_time(address: str) -> None:
    get(f"{address}api/frame")
    notes = asked(address, "notes?ids=4,7,99,x&at=2.5")
    assert [*notes] == ["4", "7"]
    assert [(one["text"], one["since"], one["start"], one["end"]) for one in notes.values()] == [
        ("until take steps {3} is being achieved", 0.6, 0.6, END),
        ("until move leg {6} is achieved", 1.4, 1.4, ""),
    ]
    assert (notes["4"]["names"], notes["4"]["last"]) == ([3], 6)
    lines = asked(address, "messages?place=4&before=1&after=0")
    assert {line["place"] for line in lines} == {3, 4}
    assert asked(address, "messages?place=99999&before=5&after=5") == []


def test_server_answers_nonsense_with_nothing(address: str) -> None:
    for what in ("notes", "notes?ids=-1,1e9&at=nan", "messages", "messages?place=x"):
        assert asked(address, what) in ({}, []) or what.startswith("messages")
    for since in ("{", "[]", '{"entry": -1}', '{"task": 1e300}', '{"entry": "x"}', "[" * 100_000):
        head, _ = parsed(get(f"{address}api/frame?since={urllib.parse.quote(since[:5000])}"))
        assert head["name"] == "walk"
    for missing in ("api/message/999999", "api/nothing", "page/../app.py"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            get(address + missing)


def test_server_gives_the_final_cause_of_a_wait(address: str) -> None:
    get(f"{address}api/frame")
    causes = asked(address, "causes?at=2.5")
    assert (causes["waiting"], causes["things"]) == (7, 1)
    assert causes["causes"] == [
        {"text": "move leg {6}, which controller handles", "tasks": 7, "goto": 6}
    ]
    assert asked(address, "causes?at=-1") == {"waiting": 0, "things": 0, "causes": []}


def test_server_needs_the_run_of_each_request(address: str) -> None:
    assert [run["name"] for run in asked(address, "runs")] == ["walk"]
    (run,) = (run["run"] for run in asked(address, "runs"))
    assert asked(address, f"message/7?run={urllib.parse.quote(run)}")["id"] == 7
    for what, why in (
        ("message/1?run=other", "404"),
        ("frame?run=other", "404"),
        ('frame?since={"entry":1}&token=old', "410"),
    ):
        with pytest.raises(urllib.error.HTTPError, match=why):
            asked(address, urllib.parse.quote(what, safe="/?=&"))


def test_server_refuses_a_foreign_host_name(address: str) -> None:
    with pytest.raises(urllib.error.HTTPError, match="400"):
        get(address, {"Host": "evil.example"})
    assert b"tca view" in get(address, {"Host": "localhost:1"})


def test_remote_page_needs_the_token_of_its_address(tmp_path: Path) -> None:
    journal = str(walking().write(tmp_path / "walk"))
    with Process("tca", "view", journal, "--no-browser", "--host", "0.0.0.0") as server:
        found = re.search(r"http://0.0.0.0:(\d+)/\?access=(\S+)", server.stdout.readline())
        assert found
        address, token = f"http://127.0.0.1:{found[1]}/", found[2]
        for what in (
            "",
            "api/runs",
            "page/page.js",
            f"api/runs?access={token}",
            "?access=guess",
            "?access=",
        ):
            with pytest.raises(urllib.error.HTTPError, match="403"):
                get(address + what)
        with pytest.raises(urllib.error.HTTPError, match="403"):
            get(f"{address}api/runs", {"Cookie": "access=guess"})
        assert json.loads(get(f"{address}api/runs", {"Cookie": f"access={token}"}))
        browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        with browser.open(f"{address}?access={token}", timeout=20) as page:
            assert (page.url, b"tca view" in page.read()) == (address, True)
        with browser.open(f"{address}api/runs", timeout=20) as runs:
            assert json.loads(runs.read())


def test_view_refuses_a_used_port_and_a_missing_journal(address: str, tmp_path: Path) -> None:
    port = address.rsplit(":", 1)[1].strip("/")
    taken = CliRunner().invoke(
        view, [str(walking().write(tmp_path / "other")), "--port", port, "--no-browser"]
    )
    assert (taken.exit_code, "give another --port" in taken.stderr) == (1, True)
    none = CliRunner().invoke(view, [str(tmp_path / "nothing"), "--no-browser"])
    assert (none.exit_code, "no such file or directory" in none.stderr) == (2, True)


def test_view_refuses_what_is_not_a_journal_before_serving(tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.tcaj"
    foreign.write_bytes(b"PK\x03\x04 this is something else altogether")
    result = CliRunner().invoke(view, [str(foreign), "--no-browser"])
    assert (result.exit_code, "not a journal of tca central" in result.stderr, result.stdout) == (
        2,
        True,
        "",
    )


@pytest.mark.parametrize("is_folder", [False, True])
def test_empty_journal_is_reported_as_empty(tmp_path: Path, is_folder: bool) -> None:
    log = tmp_path / "new"
    if is_folder:
        log.mkdir()
    (log / "00000001.tcaj" if is_folder else log).touch()
    with Process("tca", "view", str(log), "--no-browser", *["--read-only"] * is_folder) as process:
        found = re.fullmatch(r"new: (http://\S+)  .*\n", process.stdout.readline())
        assert found
        assert ("?key=" in found[1]) != is_folder
        get(found[1])  # the server serves, after all its output
        process.terminate()
        assert (
            process.communicate()[0]
            == "it is empty: the page will show what central writes to it\n"
        )


def test_live_view_waits_for_an_empty_journal(serve: Callable[[Path], str], tmp_path: Path) -> None:
    log = tmp_path / "new.tcaj"
    log.touch()
    address = serve(log)
    head, columns = parsed(get(f"{address}api/frame"))
    assert (head["state"], len(columns["task.id"])) == ("not closed", 0)
    log.write_bytes(walking().encoded())
    while not len(columns["task.id"]):
        _, columns = parsed(get(f"{address}api/frame"))
    assert len(columns["task.id"]) == 8


def test_returning_page_learns_at_once_that_the_server_is_back(address: str) -> None:
    """Otherwise the page would learn this with the next news, or after ten seconds."""
    known, _ = parsed(get(f"{address}api/frame"))
    since = urllib.parse.quote(json.dumps(known["lengths"]))
    with urllib.request.urlopen(f"{address}api/frame?since={since}&wait=0", timeout=8) as answer:
        told, _ = parsed(answer.read())
    assert told["lengths"]["entry"] >= known["lengths"]["entry"]

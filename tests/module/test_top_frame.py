"""What ``tca top`` makes of central's answers: rates, order, what fits the terminal."""

import io
import re
from typing import Any

import pytest

from tca_module.top_frame import frame, plain_frame

pytest.importorskip("rich")

from rich.console import Console

from tca_module.top_screen import screen


def resource(name: str = "legs", delivered: int = 10, busy: float = 4.0, **more: Any) -> dict[str, Any]:
    plain = {"capacity": 2, "handling": [], "blocked": 0, "waiting": 0, "oldest": 0.0, "held_by": "", "claims": 0}
    return {"resource": name, "delivered": delivered, "busy": busy, "is_reserved": False, **plain, **more}


def message(name: str, delivered: int, **more: Any) -> dict[str, Any]:
    return {"message": name, "class": "command", "delivered": delivered, "failed": 0, "waiting": 0, **more}


def answer(time: float, *resources: dict[str, Any], epoch: str = "one", **more: Any) -> dict[str, Any]:
    modules = [{"module": "legs", "process": "here:1", "resources": list(resources)},
               {"module": "tca top", "process": "here:2", "resources": []}]  # fmt: skip
    numbers: dict[str, Any] = {"events": int(time * 10), "tasks": 3, "messages": [], "waits": [], "held": []}
    return {"epoch": epoch, "time": time, "modules": modules, **numbers, **more}


def shown(text_of: Any, width: int = 100) -> str:
    file = io.StringIO()
    Console(file=file, width=width, markup=False, highlight=False, legacy_windows=False).print(text_of)
    return file.getvalue()


def test_rates_are_of_the_time_between_two_answers() -> None:
    before = answer(10.0, resource(), messages=[message("step", 10)])
    now = answer(12.0, resource(delivered=16, busy=6.0), messages=[message("step", 16)])
    told = frame(now, before, hidden="tca top")
    assert (told.span, told.events, told.modules) == (2.0, 10.0, 1)
    (legs,) = told.resources
    assert (legs.rate, legs.busy) == (3.0, 0.5)  # 2 s in two slots over 2 s
    assert told.messages[0].rate == 3.0


def test_without_an_answer_before_rates_are_of_the_whole_run() -> None:
    told = frame(answer(20.0, resource(), messages=[message("step", 10)]))
    assert (told.span, told.resources[0].rate, told.resources[0].busy, told.messages[0].rate) == (20.0, 0.5, 0.1, 0.5)


def test_after_a_restart_of_central_or_of_a_module_counting_begins_anew() -> None:
    before = answer(100.0, resource(delivered=1000, busy=90.0))
    restarted = frame(answer(4.0, resource(delivered=2, busy=2.0), epoch="two"), before)
    assert (restarted.span, restarted.resources[0].rate) == (4.0, 0.5)
    rejoined = frame(answer(104.0, resource(delivered=2, busy=2.0)), before)
    assert (rejoined.resources[0].rate, rejoined.resources[0].busy) == (0.5, 0.25)


def test_the_liveliest_messages_come_first() -> None:
    before = answer(10.0, messages=[message("once", 500), message("often", 0), message("stuck", 0)])
    now = answer(11.0, messages=[message("once", 500), message("often", 7), message("stuck", 0, waiting=2)])
    assert [line.message for line in frame(now, before).messages] == ["often", "stuck", "once"]


def test_a_screen_tells_who_does_what_and_who_waits() -> None:
    busy = resource(
        waiting=4, oldest=12.0, held_by="eyes", handling=[{"id": 7, "message": "move\x1b[31m", "seconds": 0.52}]
    )
    waits = [{"what": "'move' {9} (and 3 more)", "for": "resource 'legs' of 'legs'", "seconds": 12.0}]
    told = frame(answer(20.0, busy, messages=[message("move", 3, failed=1)], waits=waits), hidden="tca top")
    text = shown(screen(told, "ipc:///here", ""), 140)
    assert "central at ipc:///here  run one, up 0:20\n1 modules, 3 tasks, 10.0 events/s; rates of the whole run" in text
    assert "move\\x1b[31m {7}  0.5 s  locked by eyes" in text
    assert re.search(r"12.0 s +'move' \{9\} \(and 3 more\) +resource 'legs' of 'legs'", text)
    assert "nobody waits" not in text
    assert "\x1b" not in text


@pytest.mark.parametrize("height", [10, 24, 40, 240])
def test_a_screen_fits_its_terminal(height: int) -> None:
    many = [resource(f"legs {number}") for number in range(50)]
    messages = [message(f"step {number}", number) for number in range(60)]
    waits = [{"what": f"'step' {{{number}}}", "for": "legs", "seconds": 1.0} for number in range(50)]
    told = frame(answer(20.0, *many, messages=messages, waits=waits, held=waits))
    lines = shown(screen(told, "ipc:///here", "no answer for 3 s, trying again", height), 80).splitlines()
    assert len(lines) <= max(height, 24)
    assert all(len(line) <= 80 for line in lines)
    assert sum("and" in line and "more" in line for line in lines) == (4 if height < 240 else 0)
    assert "central is away: no answer for 3 s, trying again. This is how it was:" in lines[0]


def test_in_80_columns_nothing_that_matters_is_cut() -> None:
    busy = resource(
        waiting=4, oldest=12.0, blocked=1, held_by="eyes", handling=[{"id": 7, "message": "move leg", "seconds": 0.5}]
    )
    other = resource("ankles", capacity=1, blocked=1, handling=[{"id": 8, "message": "look", "seconds": 90.0}])
    held = [{"what": "'wave' {9}", "for": "end achieving of 'walk' {3}", "seconds": 31.0}]
    text = shown(screen(frame(answer(20.0, busy, other, held=held)), "ipc:///here", ""), 80)
    assert re.search(r"legs x2 +10% +0.5 +4, 12.0 s +locked by eyes  1 blocked: move leg \{7\}", text)
    assert re.search(r"legs / ankles +20% +0.5 +blocked: look \{8\}  90.0 s", text)
    assert re.search(r"31.0 s +'wave' \{9\} +end achieving of 'walk' \{3\}", text)


def test_nothing_is_told_in_words() -> None:
    text = shown(screen(frame(answer(1.0)), "ipc:///here", ""))
    for words in ("no module offers to handle anything", "no messages have been declared", "nobody waits"):
        assert words in text


def test_a_frame_in_plain_values() -> None:
    told = plain_frame(frame(answer(20.0, resource(), messages=[message("step", 10)])))
    assert told["resources"][0]["module"] == "legs"
    assert told["messages"][0]["delivered"] == 10

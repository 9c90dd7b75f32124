"""The screen that ``tca top`` makes of central's answers: rates, order, size."""

import io
import json
import math
import re
from collections.abc import Callable
from textwrap import indent
from typing import Any

import msgspec
import pytest

from tca_tools.live.shared import as_json
from tca_tools.live.top_frame import frame
from tca_wire.points import Moment
from tca_wire.waits import Waiter, WaitFor, WaitKind

pytest.importorskip("rich")

from rich.console import Console

from tca_tools.live.top_screen import screen


def plain(waiter: Waiter) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.to_builtins(waiter)
    return found


def resource(
    name: str = "legs", delivered: int = 10, busy: float = 4.0, **more: Any
) -> dict[str, Any]:
    plain = {
        "capacity": 2,
        "handling": [],
        "blocked": 0,
        "waiting": 0,
        "oldest": 0.0,
        "held_by": "",
        "claims": 0,
    }
    return {
        "resource": name,
        "delivered": delivered,
        "busy": busy,
        "is_reserved": False,
        **plain,
        **more,
    }


def message(name: str, delivered: int, **more: Any) -> dict[str, Any]:
    return {
        "message": name,
        "class": "command",
        "delivered": delivered,
        "failed": 0,
        "dropped": 0,
        "waiting": 0,
        **more,
    }


def answer(
    time: float, *resources: dict[str, Any], epoch: str = "one", **more: Any
) -> dict[str, Any]:
    modules = [
        {"module": "legs", "process": "here:1", "resources": list(resources)},
        {"module": "tca top", "process": "here:2", "resources": []},
    ]
    lists: dict[str, Any] = {"messages": [], "waits": [], "held": [], "suspended": [], **more}
    totals = {kind: len(lists[kind]) for kind in ("waits", "held", "suspended")}
    numbers = {
        "epoch": epoch,
        "time": time,
        "events": int(time * 10),
        "tasks": 3,
        "looked_at": 3,
        "overloads": 0,
    }
    memory = {"messages": (5 << 20, 256 << 20), "answers": (0, 64 << 20)}
    return {"modules": modules, "totals": totals, "memory": memory, **numbers, **lists}


def shown(text_of: Any, width: int = 100) -> str:
    file = io.StringIO()
    Console(file=file, width=width, markup=False, highlight=False, legacy_windows=False).print(
        text_of
    )
    return file.getvalue()


def test_rates_cover_the_time_between_two_answers() -> None:
    before = answer(10.0, resource(), messages=[message("step", 10)])
    now = answer(12.0, resource(delivered=16, busy=6.0), messages=[message("step", 16)])
    made_frame = frame(now, before, hidden="tca top")
    assert (made_frame.span, made_frame.events, made_frame.modules) == (2.0, 10.0, 1)
    (legs,) = made_frame.resources
    assert (legs.rate, legs.busy) == (3.0, 0.5)  # 2 s in two slots over 2 s
    assert made_frame.messages[0].rate == 3.0
    first = frame(before)  # of the whole run
    assert (
        first.span,
        first.resources[0].rate,
        first.resources[0].busy,
        first.messages[0].rate,
    ) == (
        10.0,
        1.0,
        0.2,
        1.0,
    )


def test_counts_restart_with_central_or_a_module() -> None:
    before = answer(100.0, resource(delivered=1000, busy=90.0))
    restarted = frame(answer(4.0, resource(delivered=2, busy=2.0), epoch="two"), before)
    assert (restarted.span, restarted.resources[0].rate) == (4.0, 0.5)
    rejoined = frame(answer(104.0, resource(delivered=2, busy=2.0)), before)
    assert (rejoined.resources[0].rate, rejoined.resources[0].busy) == (0.5, 0.25)


def test_liveliest_messages_come_first() -> None:
    before = answer(10.0, messages=[message("once", 500), message("often", 0), message("stuck", 0)])
    now = answer(
        11.0, messages=[message("once", 500), message("often", 7), message("stuck", 0, waiting=2)]
    )
    assert [line.message for line in frame(now, before).messages] == ["often", "stuck", "once"]


def waiting(number: int, why: str = "legs") -> list[dict[str, Any]]:
    waits = (WaitFor(WaitKind.RESOURCE, module=why),)
    return [plain(Waiter(one, "step", seconds=1.0, waits=waits)) for one in range(1, number + 1)]


def suspended_for_long() -> list[dict[str, Any]]:
    return [
        plain(
            Waiter(
                213,
                "mop floor",
                seconds=40.0,
                waits=(WaitFor(WaitKind.RESUME, module="operator panel"),),
            )
        )
    ]


TROUBLE: dict[str, dict[str, Any]] = {
    "torch": {"waiting": 1, "oldest": 9.0},
    "table": {"held_by": "waiter"},
}
SECONDS = {
    "idle": 0,
    "slow": 0,
    "quick": 0,
    "torch": 0,
    "sink": 0,
    "oven": 20,
    "stove": 40,
    "knife": 8,
    "table": 0,
}
KITCHEN = [resource(name, busy=busy, **TROUBLE.get(name, {})) for name, busy in SECONDS.items()]
BUSY = resource(
    waiting=4,
    oldest=12.0,
    held_by="eyes",
    handling=[{"id": 7, "message": "move\x1b[31m", "seconds": 0.52}],
)
BLOCKED: dict[str, Any] = {
    "blocked": 1,
    "handling": [{"id": 8, "message": "look", "seconds": 90.0}],
}
CANCELLED = {"id": 7, "message": "move leg", "state": "cancel requested", "seconds": 0.5}
MOVES = plain(
    Waiter(9, "move", more=3, seconds=12.0, waits=(WaitFor(WaitKind.RESOURCE, module="legs"),))
)
WALK = WaitFor(WaitKind.CONSTRAINT, 3, "walk", Moment.END_ACHIEVING)
STEPS = [message(f"step {number}", number) for number in range(60)]
SCREENS: dict[str, tuple[dict[str, Any], int, int | None]] = {
    "modules work and a message waits": (
        answer(20.0, BUSY, messages=[message("move", 3, failed=1)], waits=[MOVES]), 140, None
    ),
    "a small terminal has no room for messages": (
        answer(99.0, resource(), messages=STEPS, waits=waiting(3, "map"), suspended=suspended_for_long()), 40, 12
    ),
    "the busy resources and the oldest waits come first": (
        answer(20.0, *KITCHEN, messages=STEPS[:9], waits=waiting(4, "map"), held=waiting(2), suspended=suspended_for_long()),
        100, 30,
    ),
    "a run stands because a task is suspended": (answer(99.0, resource(), suspended=suspended_for_long()), 100, None),
    "80 columns": (
        answer(20.0, BUSY | BLOCKED, resource("ankles", capacity=1, **BLOCKED),
               held=[plain(Waiter(9, "wave", seconds=31.0, waits=(WALK,)))]), 80, None,
    ),
    "a task is to be cancelled": (
        answer(20.0, resource(handling=[CANCELLED, {**CANCELLED, "id": 8, "state": ""}])), 100, None
    ),
    "nothing is there": (answer(1.0), 100, None),
}  # fmt: skip


def test_top_shows_the_expected_screens(approve: Callable[..., None]) -> None:
    def screen_text(name: str) -> str:
        central_answer, width, height = SCREENS[name]
        lines = shown(
            screen(frame(central_answer, hidden="tca top"), "ipc:///here", "", height), width
        ).splitlines()
        assert len(lines) <= (height or 100)
        return indent("\n".join(line.rstrip() for line in lines), "    ").strip()

    approve("screens.txt", screen_text)


@pytest.mark.parametrize("width", [40, 80])
@pytest.mark.parametrize(("height", "cut"), [(10, 1), (24, 3), (240, 0)])
def test_screen_fits_its_terminal(height: int, width: int, cut: int) -> None:
    many = [resource(f"legs {number}") for number in range(50)]
    messages = [message(f"step {number}", number) for number in range(60)]
    made_frame = frame(answer(20.0, *many, messages=messages, waits=waiting(50), held=waiting(50)))
    lines = shown(
        screen(made_frame, "ipc:///here", "no answer for 3 s, trying again", height), width
    ).splitlines()
    assert len(lines) <= height
    assert all(len(line) <= width for line in lines)
    assert sum("and" in line and "more" in line for line in lines) == cut
    assert "central is away: no answer for 3 s" in lines[0]


def test_counts_include_rows_that_are_not_listed() -> None:
    totals = {"waits": 1, "held": 190, "suspended": 0}
    made_frame = frame(answer(20.0, waits=waiting(1), held=waiting(50)) | {"totals": totals})
    assert "... and 140 more\n" in shown(screen(made_frame, "ipc:///here", ""))
    text = shown(screen(made_frame, "ipc:///here", "", 32))
    found = re.search(r"and (\d+) more", text)
    assert found
    assert text.count("step {") - 1 + int(found[1]) == 190
    assert (len(made_frame.held), made_frame.totals, made_frame.is_cut) == (50, totals, True)
    assert not frame(answer(20.0, waits=waiting(1))).is_cut


def test_top_says_which_of_very_many_tasks_it_counted() -> None:
    made_frame = frame(answer(20.0, held=waiting(1)) | {"tasks": 12_000, "looked_at": 10_000})
    assert "... and no more among the 10000 oldest tasks\n" in shown(
        screen(made_frame, "ipc:///here", "")
    )
    assert (made_frame.not_looked_at, made_frame.is_cut) == (2000, True)


def test_top_shows_the_fullest_memory_limit_and_refusals() -> None:
    central_answer = answer(20.0)
    assert frame(central_answer).memory == "memory 5 MiB"
    central_answer |= {
        "memory": {"messages": (200 << 20, 256 << 20), "answers": (40 << 20, 64 << 20)},
        "overloads": 1200,
    }
    assert (
        frame(central_answer).memory
        == "memory 240 MiB, messages 200 MiB of 256 MiB, 1,200 refused or dropped when it was full"
    )


def test_json_for_programs_has_no_nan() -> None:
    text = as_json({"x": [math.nan, -math.inf, 1.5], math.inf: {"deep": (math.nan,)}})
    assert json.loads(text, parse_constant=pytest.fail) == {
        "x": ["nan", "-inf", 1.5],
        "inf": {"deep": ["nan"]},
    }

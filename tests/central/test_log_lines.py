"""Central's log has one line for each entry, even with hostile contents."""

import logging

import pytest
from central.player import Player

from tca_central.events import Record
from tca_central.shell.log_limit import LineLimit
from tca_central.shell.log_lines import LONGEST_LINE, LineFormatter, LogLines
from tca_central.shell.loss_log import LossLog, loss_in
from tca_wire.journal import facts
from tca_wire.journal.facts import (
    Entry,
    Fact,
    Failed,
    Ignored,
    ModuleJoined,
    ModuleLeft,
    RequestRefused,
)
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.vocabulary import Dropping, Refusal

HOSTILE = "\x1b]0;mine\x07\x1b[2J\nroot: all is well\r\u202e\x00" + "x" * 200_000


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def log(lines: list[str]) -> logging.Logger:
    class ListHandler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            lines.append(self.format(record))

    log, handler = logging.getLogger("tests.lines"), ListHandler()
    handler.setFormatter(LineFormatter("central: %(message)s"))
    log.handlers, log.propagate = [handler], False
    log.setLevel(logging.INFO)
    return log


def test_log_entry_is_one_short_printable_line(log: logging.Logger, lines: list[str]) -> None:
    player = Player()
    facts: list[Fact] = [
        ModuleJoined(HOSTILE, HOSTILE),
        ModuleLeft(HOSTILE, HOSTILE, lost=True),
        RequestRefused(HOSTILE, Refusal.PROTOCOL, HOSTILE),
        RequestRefused(HOSTILE, Refusal.OVERLOAD, HOSTILE),
        Ignored(HOSTILE, HOSTILE),
        Failed(1, HOSTILE, HOSTILE),
    ]
    LogLines(log, player.central).write(Record(Entry(1, 1.0, facts), {1: HOSTILE}))
    assert len(lines) == len(facts)
    for line in lines:
        assert line.isprintable()
        assert line.startswith("central: ")
        assert len(line) <= LONGEST_LINE


def test_traceback_is_logged_on_separate_printable_lines(
    log: logging.Logger, lines: list[str]
) -> None:
    try:
        int(HOSTILE)
    except ValueError:
        log.exception("broken")
    first, *rest = lines[0].split("\n")
    assert first == "central: broken"
    assert len(rest) > 2
    assert all(line.isprintable() and len(line) <= LONGEST_LINE for line in rest)


def test_line_limit_counts_omitted_lines_and_passes_errors(
    log: logging.Logger, lines: list[str]
) -> None:
    now = [5.0]
    limit = LineLimit(lambda: now[0])
    log.handlers[0].addFilter(limit)
    for number in range(limit.most + 1000):
        log.warning("refused %d", number)
    log.error("broken")
    assert len(lines) == limit.most + 1
    assert lines[-1] == "central: (1,000 lines left out: see the journal) broken"
    now[0] = 6.0
    log.warning("100%")
    assert lines[-1] == "central: 100%"


# --- failures whose exception handlers are for another failure ------------------------------------


def lines_of(player: Player, log: logging.Logger, lines: list[str]) -> list[str]:
    """Return the warnings of exception handlers in a life, by their last words."""
    writer = LogLines(log, player.central)
    writer.write(Record(Entry(1, 1.0, player.facts(facts.Attached))))
    found = player.facts(Failed) + player.facts(facts.Unhandled)
    writer.write(Record(Entry(2, 2.0, found), dict.fromkeys([0, 1, 2, 3], "")))
    return [line for line in lines if line.endswith("?") or "no module" in line]


@pytest.mark.parametrize(
    ("attached", "raised", "words"),
    [
        ("Time out", "burn", ["did you mean 'timeout'?"]),
        ("module losst", "burn", ["did you mean 'module lost'?"]),
        ("cup lost", "burn", []),
        ("colision", "collision", ["'colision' has one: do both mean the same?"]),
        ("burn", "collision", []),
        ("burn", "fell", ["exception handler 'shrug', which is attached to failure 'fell'"]),
    ],
)
def test_similar_failure_of_a_handler_is_logged(
    attached: str, raised: str, words: list[str], log: logging.Logger, lines: list[str]
) -> None:
    player = Player()
    player.module("legs", "command move")
    player.module("expert", "exception handler recover")
    player.hello("coach")
    player.declare("coach", "exception handler shrug")
    player.request("expert", headers.Attach, Attachment(attached, "recover"))
    player.request("coach", headers.Attach, Attachment("fell", "shrug"))
    player.task("legs", "move")
    player.fail("legs/1", raised)
    found = lines_of(player, log, lines)
    assert len(found) == len(words)
    assert all(line.endswith(word) for line, word in zip(found, words, strict=True))


# --- repeated losses: one line a second for each kind, with a count -------------------------------


def test_repeated_losses_are_logged_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    log = LossLog(logging.getLogger("t"))
    for number in range(3000):
        log.count("dropped 'pose'", f"{number} wait", number / 1000)
    log.count("dropped 'map'", "2 wait", 3.0)
    log.write_due(3.1)
    log.write_due()
    assert caplog.messages == [
        "dropped 'pose': 0 wait",
        "dropped 'pose' 1,000 times: 1000 wait",
        "dropped 'pose' 1,000 times: 2000 wait",
        "dropped 'map': 2 wait",
        "dropped 'pose' 999 times: 2999 wait",
    ]


def test_loss_is_not_logged_again_until_it_recurs(caplog: pytest.LogCaptureFixture) -> None:
    log = LossLog(logging.getLogger("t"))
    log.count("dropped 'pose'", "10 wait", 0.0)
    for time in (1.0, 2.0, 3.0):
        log.write_due(time)
    log.count("dropped 'pose'", "10 wait", 3.1)
    assert caplog.messages == ["dropped 'pose': 10 wait"] * 2


@pytest.mark.parametrize(
    ("fact", "loss"),
    [
        (
            facts.Dropped(7, "pose", "10 wait", dropping=Dropping.OVERLOAD),
            ("dropped 'pose'", "10 wait"),
        ),
        (facts.Dropped(7, "pose", "a newer one", dropping=Dropping.DISPLACED), None),
        (facts.Dropped(7, "pose", "nobody listens"), None),
        (
            facts.RequestRefused("user", Refusal.OVERLOAD, "10 wait"),
            ("refused module 'user'", "10 wait"),
        ),
        (facts.RequestRefused("user", Refusal.CYCLE, "it waits for itself"), None),
    ],
)
def test_only_overload_facts_are_logged_as_losses(fact: facts.Fact, loss: object) -> None:
    assert loss_in(fact) == loss

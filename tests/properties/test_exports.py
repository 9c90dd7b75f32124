"""Exports of random lives keep the rules of their formats and contain all messages and runs."""

import io
import tempfile
from pathlib import Path
from typing import Any

from central.player import Player
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from properties.life import Life, Operations, operations
from tools.trace_reader import read_trace

from tca_tools.export.mcap_file import write_mcap
from tca_tools.export.tables import TABLES
from tca_tools.export.trace.packets import write_trace
from tca_tools.journal.fold import History
from tca_tools.stats.measure import measure
from tca_wire.journal.facts import Entry


@given(operations, st.integers(1, 5))
@settings(max_examples=18)
def test_exports_are_valid_and_complete_in_short_life(taken: Operations, tick: int) -> None:
    check(Life(Player(check=False)).live(taken), tick)


@given(st.integers(0, 1 << 32), st.integers(1, 5))
@example(900, 1)  # a wait is given up long after its handler has returned
@settings(max_examples=2)
def test_exports_are_valid_and_complete_in_long_life(seed: int, tick: int) -> None:
    life = Life(Player(check=False))
    life.go_on(seed, 400)
    check(life, tick)


def check(life: Life, tick: int) -> None:
    """Check all exports, with a clock of *tick* seconds."""
    entries = [
        Entry(entry.number, entry.time // tick * tick, entry.facts) for entry in life.player.entries
    ]
    history = History.until(entries)
    check_trace(history)
    check_mcap(history, entries)
    check_stats(history)
    for table in TABLES:
        assert all(len(row) == len(table.columns) for row in table.rows(history))


def check_mcap(history: History, entries: list[Entry]) -> None:
    stream = io.BytesIO()
    write_mcap(history, entries, stream)
    stream.seek(0)
    messages = list(make_reader(stream).iter_messages(log_time_order=False))
    times = [message.log_time for _, _, message in messages]
    assert times == sorted(times)
    topics = [channel.topic for _, channel, _ in messages]
    assert topics.count("/tca/facts") == sum(len(entry.facts) for entry in entries)
    assert sum(topic.startswith("/messages/") for topic in topics) == len(history.messages)


def check_trace(history: History) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.pftrace"
        with path.open("wb") as stream:
            write_trace(history, stream)
        read = read_trace(path.read_bytes())
    found: dict[str, list[Any]] = {}
    for one in read.slices:
        found.setdefault(one.category, []).append(one)
    assert len(found.get("handling", [])) == len(history.handlings)
    assert len(found.get("queued", [])) == len(history.queueings)
    assert len(found.get("task", [])) == len(history.tasks)
    waits = [wait for handling in history.handlings for wait in handling.waits]
    waits += [wait for module in history.modules.values() for wait in module.waits]
    assert len(found.get("waiting", [])) == len(waits)
    open_ones = sum(handling.end is None for handling in history.handlings)
    assert sum(one.end is None for one in found.get("handling", [])) == open_ones
    assert all(values[-1][1] >= 0 for values in read.counters.values())


def check_stats(history: History) -> None:
    measured = measure(history)
    assert sum(stats.sent for stats in measured.messages) == len(history.messages)
    assert sum(stats.handled for stats in measured.messages) == sum(
        one.end is not None for one in history.handlings
    )
    for resource in measured.resources:
        if use := resource.use:
            assert 0 <= use.waiting <= use.busy + 1e-9
            assert use.busy <= (measured.end - measured.start) * max(resource.capacity, 1) + 1e-9

"""How the tree grew, as lines of text: each state that a task came to, one after the other."""

from collections.abc import Iterator

import click

from tca_tools.replay.recording import Recording
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import standing
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.text import COLOURS
from tca_tools.terminal import columns_of, cut

_DEEPEST = 12
_SHORTEST_STATE = 12
"""Columns that are kept for a state."""
_SHORTEST_NAME = 8
_FAR = 100
"""Waits: what is waited for beyond so many is not looked for, or a long run would take very long."""


def growth_lines(recording: Recording, start: float, width: int | None) -> Iterator[str]:
    """The lines from a time on: ``+`` for what is sent, then what becomes of it and why it waits."""
    run = recording.run
    changes = [
        (time, number, order) for number, task in run.tasks.items() for order, (time, _) in enumerate(task.states)
    ]
    for time, number, order in sorted(changes):
        clock = recording.time(recording.place_of_record(time))
        if clock < start:
            continue
        at = RunAt(run, time)
        task = at.tasks[number]
        state = standing(run, run.tasks[number], run.tasks[number].states[order][1], time)
        depth = recording.depths[number]
        indent = "  " * depth if depth <= _DEEPEST else f"{'  ' * _DEEPEST}[{depth}] "
        start_of_line = f"{clock:10.3f}  {' ' if order else '+'} {indent}"
        room = None if width is None else max(width - len(start_of_line) - _SHORTEST_STATE, _SHORTEST_NAME)
        line = f"{start_of_line}{cut(words.called(task), room)}: "
        note = words.note_of(at, task, within=_FAR)
        told = note.within(None, at.time)
        said = told if note.says_state else ", ".join(filter(None, (state, told)))
        rest = cut(said, None if width is None else max(width - columns_of(line), _SHORTEST_STATE - 2))
        yield line + click.style(rest[: len(state)], fg=COLOURS[state]) + rest[len(state) :]

"""The growth of the tree as lines of text: each change of a task's state, in order."""

from collections.abc import Iterator

import click

from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import standing
from tca_tools.replay.recording import Recording
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.text import COLOURS
from tca_tools.terminal import columns_of, cut
from tca_wire.points import ROOT

_DEEPEST, _NARROW = 12, 40
"""The most levels that are indented, and the columns that are left for text."""
_SHORTEST_STATE, _SHORTEST_NAME = 12, 8
"""The least columns of a state and of a name."""
_MOST_WAITS = 100
"""The most waits that are followed to explain a state; more would slow down long runs."""


def growth_lines(recording: Recording, start: float, width: int | None) -> Iterator[str]:
    """Yield the lines from a time on: ``+`` for a task that is sent, then its later states.

    Each line says why the task waits.
    """
    run, deepest = recording.run, _DEEPEST
    if width is not None:
        deepest = min(max(width - _NARROW, 0) // 2, _DEEPEST)
    depths = {int(ROOT): -1}
    for number in sorted(run.tasks):  # parents have smaller numbers
        depths[number] = depths[run.tasks[number].parent] + 1
    changes = []
    for number, task in run.tasks.items():
        changes += [(time, number, order) for order, (time, _) in enumerate(task.states)]
    for time, number, order in sorted(changes):
        clock = recording.time(recording.place_of_record(time))
        if clock < start:
            continue
        at, depth = RunAt(run, time), depths[number]
        state = standing(run, run.tasks[number], run.tasks[number].stage(order)[1], time)
        start_of_line = f"{clock:10.3f}  {' ' if order else '+'} {'  ' * min(depth, deepest)}"
        if depth > deepest:
            start_of_line += f"[{depth}] "
        name = words.called(at.tasks[number])
        note = words.note_of(at, at.tasks[number], within=_MOST_WAITS)
        if width is not None:
            name = cut(name, max(width - len(start_of_line) - _SHORTEST_STATE, _SHORTEST_NAME))
        line = cut(f"{start_of_line}{name}: ", width)
        text = ", ".join(filter(None, (state, note.within(None, at.time))))
        rest = cut(text, None if width is None else width - columns_of(line))
        state_in_colour = click.style(rest[: len(state)], fg=COLOURS[state])
        yield line + state_in_colour + rest[len(state) :]

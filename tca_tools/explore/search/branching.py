"""The causes of many states in a scenario: the sources of actions that compete with others."""

from collections import Counter
from collections.abc import Iterable

from tca_tools.explore.play.play import Action, ActionKind, Play

_MOST_NAMED = 4

_TIMES = {
    "release": "delays",
    "deadline": "the deadline of {}",
    "attempt": "the timeout of an attempt of {}",
    "kill": "a later kill of {}",
    "test": "the period of monitor {}",
    "watched": "the duration of monitor {}",
    "claim": "the timeout of a lock",
    "hung": "the check for a handler that hangs",
}
"""By purpose of a timer: its name in a report."""

_SOURCES = {
    ActionKind.JOIN: "{} joining",
    ActionKind.BREAK: "the loss of {}",
    ActionKind.LEAVE: "{} leaving",
    ActionKind.GOODBYE: "{} leaving",
    ActionKind.TIMEOUT: "timeouts of {}",
    ActionKind.KILL: "kills of {}",
    ActionKind.SUSPEND: "suspensions of {}",
    ActionKind.RESUME: "suspensions of {}",
    ActionKind.TIME: "{}",
}
"""By kind of action: its source. Actions of other kinds are steps of a module."""


class Branching:
    """Counts, for each source of actions, the states in which it competes with other sources."""

    def __init__(self) -> None:
        self._states = 0
        self._open: Counter[str] = Counter()

    def add(self, play: Play, actions: Iterable[Action]) -> None:
        """Count a state and the actions that are possible in it."""
        self._states += 1
        sources = {_source(play, action) for action in actions}
        if len(sources) > 1:
            self._open.update(sources)

    def most(self) -> tuple[str, ...]:
        """Return the commonest sources, with their part of the states: "steps of arm (61 %)"."""
        most = sorted(self._open.items(), key=lambda item: (-item[1], item[0]))[:_MOST_NAMED]
        return tuple(f"{source} ({100 * number / self._states:.0f} %)" for source, number in most)


def _source(play: Play, action: Action) -> str:
    name = _due(play) if action.kind is ActionKind.TIME else action.name
    if name in play.lines:
        name = play.lines[name].run.module.name
    elif name in play.runs:
        name = play.runs[name].module.name
    return _SOURCES.get(action.kind, "steps of {}").format(name)


def _due(play: Play) -> str:
    """Return the name of the event that is due next."""
    timer = min(play.central.clock.pending(), key=lambda timer: timer.time, default=None)
    if timer is None or timer.time != play.next_time:
        return "timeouts of scripts"
    task = getattr(timer.subject, "task", None)
    return _TIMES.get(timer.due, "time").format(
        f"'{task.message.name}'" if task is not None else "tasks"
    )

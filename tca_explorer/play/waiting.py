"""What waits in a run, and whether it still waits for the same after an action."""

from collections.abc import Sequence

from tca_explorer.observed.messages import TrackedMessage
from tca_explorer.play.actors import Actor
from tca_explorer.play.play import Play
from tca_explorer.scenario.steps import ScriptRun

Waiting = tuple[int] | tuple[Actor, ScriptRun]
"""A task that is held or queued, by id; a script, at that point of its life."""


def waiting(play: Play) -> list[Waiting]:
    """The tasks that wait by themselves, not for what is under them, oldest first; and the scripts."""
    tasks = play.fold.tasks
    parents = {task.parent_id for task in tasks if not task.is_over}
    return [
        *((task.id,) for task in tasks if _waits(task) and task.id not in parents),
        *((actor, actor.life) for name in sorted(play.lines) for actor in play.lines[name].actors
          if actor.step is not None),
    ]  # fmt: skip


def carried(before: Sequence[Waiting], play: Play) -> tuple[int, ...]:
    """Where among what waits now is what waited before; -1: it does not."""
    now = waiting(play)
    return tuple(now.index(one) if one in now else -1 for one in before)


def _waits(task: TrackedMessage) -> bool:
    """Central itself carries monitors out: they go on, and do not wait."""
    return not (task.is_over or task.is_handled or task.message_class.is_monitor)

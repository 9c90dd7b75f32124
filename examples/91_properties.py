"""Properties of runs of ``01_fetch.py``. ``tca check LOG 91_properties.py`` checks a run."""

from collections.abc import Iterator

from tca_module import Command, Goal
from tca_tools.check.records import MessageRecord
from tca_tools.check.world import JournalWorld
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_tools.properties import at_most, being_achieved, in_at_least, never

FETCH, GRASP = Goal("fetch", str), Command("grasp", str)


def waits_long(world: JournalWorld) -> list[MessageRecord]:
    """Return the messages that have been in a queue for more than five seconds."""
    waits = {task: world.run.tasks[task.id].queueing for task in world.tasks if task.is_queued}
    return [task for task, wait in waits.items() if wait and world.now - wait.start > 5.0]


def fetch_is_quick(run: Run) -> Iterator[tuple[Task, bool]]:
    """Yield each ended goal, and whether it took less than a minute."""
    for task in run.tasks.values():
        if task.name == FETCH.name and task.has_ended:
            yield task, task.states[-1][0] - task.received < 60.0


ONE = at_most(1, being_achieved(FETCH))
PATIENCE = never(waits_long)
SPEED = in_at_least(0.9, fetch_is_quick)
PROPERTIES = ["never failed of grasp", "drive achieved before grasp begun"]

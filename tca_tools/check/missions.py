"""Rules of mission tasks: a task that did not complete has failed or was killed."""

from contextlib import suppress

from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import MISSION
from tca_tools.check.world import JournalWorld
from tca_wire.errors import BadData
from tca_wire.journal import facts
from tca_wire.messages.formats import MISSION_TASK, decode_untyped
from tca_wire.vocabulary import Outcome

_COMPLETED = 132  # Status.COMPLETED | Status.TERMINATED, in the results of tasks


def check_status(world: JournalWorld, item: MessageRecord, fact: facts.Returned) -> None:
    """Check the status with which a mission task's handler returned."""
    if fact.outcome is Outcome.DONE and not item.is_killed and _is_of_mission(world, item):
        status = _status(fact.body)
        if status != _COMPLETED:
            world.report(MISSION, item, f"has status {status}, but counts as done")


def check_recovered(world: JournalWorld, task: MessageRecord) -> None:
    """Check that a mission has not dealt with the failure of its task itself."""
    handler = task.ended_handlers[0] if task.ended_handlers else None
    is_mission = handler is not None and handler.message.startswith("mission ")
    if is_mission and _is_of_mission(world, task):
        what = f"failed ({task.failure}), but counts as done, since {handler} dealt with that"
        world.report(MISSION, task, what)


def _is_of_mission(world: JournalWorld, item: MessageRecord) -> bool:
    declared = world.declared.get(item.message)
    return declared is not None and MISSION_TASK in declared.data


def _status(body: bytes) -> object:
    with suppress(BadData, AttributeError):
        return decode_untyped(body).get("status")
    return None

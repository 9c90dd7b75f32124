"""Records of ended tasks that modules keep: data, outcome and place in the tree.

A task that a module keeps leaves a record when it ends, under its parent: the living task, the
root, or that one's record. A record goes when nobody keeps it any more (each module keeps for
itself, and a module that leaves keeps nothing), or when what it hangs under ends without being kept
or goes itself. (TCM: SetPersistence; TDL: PERSISTENT; TCA 8.5 kept every node until its references
were released.)
"""

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection, Module
from tca_central.model.tasks import Keeping, KeptTask, Task
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.points import TaskId
from tca_wire.vocabulary import Refusal

MOST_KEPT = 10_000
"""Tasks that all modules together may keep, living ones too."""


def on_keep(central: State, connection: Connection, header: headers.Keep, _: bytes) -> None:
    """A module keeps a task from now on, or no longer; letting go a task that is not kept is no
    error.
    """
    task = central.tree.task(header.task)
    record = central.memory.kept.get(header.task)
    if header.release:
        release(central, header.task, connection.module)
    elif task is None and record is None:
        raise RequestError(
            Refusal.TOO_LATE, f"task {header.task} has ended: ask that it be kept before it does"
        )
    else:
        keep(central, task or record, connection.module)
    central.accept(connection, header.number, header.task)


def check_room(central: State) -> None:
    """Raises RequestError if no more tasks can be kept."""
    if central.memory.promises >= MOST_KEPT:
        text = f"{MOST_KEPT} tasks are kept already: release those that nobody asks for any more"
        raise RequestError(Refusal.OVERLOAD, text)


def keep(central: State, task: Task | KeptTask | None, module: Module) -> None:
    """Let *module* keep a task, or the record of one; twice is once."""
    assert task is not None
    if task.id in module.keeps:
        return
    check_room(central)
    Keeping.of(task).by[module] = None
    module.keeps[task.id] = None
    central.memory.promises += 1
    central.facts.append(facts.Kept(task.id, module.name))


def release(central: State, task_id: int, module: Module) -> None:
    """*module* keeps a task no longer."""
    if task_id not in module.keeps:
        return
    del module.keeps[task_id]
    central.memory.promises -= 1
    central.facts.append(facts.Released(TaskId(task_id), module.name))
    record = central.memory.kept.get(task_id)
    keeping = Keeping.of(record or central.tree.tasks[task_id])
    del keeping.by[module]
    if record is not None and not keeping.by:
        _drop(central, record)


def release_all(central: State, module: Module) -> None:
    """A module is gone, and keeps nothing."""
    for task_id in list(module.keeps):
        release(central, task_id, module)


def keep_or_drop(central: State, task: Task, keeping: Keeping) -> None:
    """A task has ended: remember it, if it is kept; else what hangs under it goes, too."""
    if not keeping.by:
        for record in list(keeping.records.values()):
            _drop(central, record)
        return
    record = KeptTask(task, central.outcome(task), keeping)
    record.siblings[record.id] = record
    central.memory.kept[record.id] = record
    central.memory.kept_bytes += record.size
    while central.memory.kept_bytes > central.budget.kept:  # the oldest go first
        _drop(central, next(iter(central.memory.kept.values())))


def _drop(central: State, record: KeptTask) -> None:
    """Forget a record, and all under it."""
    record.siblings.pop(record.id)
    forgotten = [record]
    while forgotten:
        one = forgotten.pop()
        forgotten.extend(one.keeping.records.values())
        del central.memory.kept[one.id]
        central.memory.kept_bytes -= one.size
        for module in one.keeping.by:
            del module.keeps[one.id]
            central.memory.promises -= 1
        central.facts.append(facts.Released(one.id, ""))

"""Records of ended tasks that modules retain: data, outcome and place in the tree.

A retained task leaves a record when it ends. The record stands under the task's parent or, if the
parent has ended, under the parent's record. A record is dropped when no module retains it any more;
a module that leaves retains nothing. A record is also dropped when the task above it ends without
being retained, or when the record above it is dropped. When all records take too much memory, the
oldest is dropped. (TCM: SetPersistence; TDL: PERSISTENT; TCA 8.5 kept every node until its
references were released.)
"""

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection, Module
from tca_central.model.tasks import Retention, Task, TaskRecord
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.points import TaskId
from tca_wire.vocabulary import Refusal

MOST_RETAINED = 10_000
"""Tasks that all modules together may retain, living ones included."""


def on_keep(central: State, connection: Connection, header: headers.Keep, _: bytes) -> None:
    """Retain a task for a module from now on, or release the task. A second release is allowed."""
    task = central.tree.task(header.task) or central.memory.records.get(header.task)
    if header.release:
        release(central, header.task, connection.module)
    elif task is None:
        raise RequestError(
            Refusal.TOO_LATE, f"task {{{header.task}}} has ended: keep it before it ends"
        )
    else:
        keep(central, task, connection.module)
    central.accept(connection, header.number, header.task)


def check_retained_room(central: State) -> None:
    """Raise RequestError if no more tasks can be retained."""
    if central.memory.retentions >= MOST_RETAINED:
        text = f"{MOST_RETAINED:,} tasks are kept already: release some first"
        raise RequestError(Refusal.OVERLOAD, text)


def keep(central: State, task: Task | TaskRecord, module: Module) -> None:
    """Retain a task, or its record, for a module, unless the module retains it already."""
    if task.id in module.retained:
        return
    check_retained_room(central)
    Retention.of(task).by[module] = None
    module.retained[task.id] = None
    central.memory.retentions += 1
    central.facts.append(facts.Kept(task.id, module.name))


def release(central: State, task_id: int, module: Module) -> None:
    """Release a task for a module, if the module retains it."""
    if task_id not in module.retained:
        return
    del module.retained[task_id]
    central.memory.retentions -= 1
    central.facts.append(facts.Released(TaskId(task_id), module.name))
    record = central.memory.records.get(task_id)
    keeping = Retention.of(record or central.tree.tasks[task_id])
    del keeping.by[module]
    if record is not None and not keeping.by:
        _drop(central, record)


def release_all(central: State, module: Module) -> None:
    """Release all tasks of a module that has left."""
    for task_id in list(module.retained):
        release(central, task_id, module)


def retain_or_drop(central: State, task: Task, keeping: Retention) -> None:
    """Record an ended task if it is retained; else drop the records under it."""
    if not keeping.by:
        for record in list(keeping.records.values()):
            _drop(central, record)
        return
    record = TaskRecord(task, central.outcome(task), keeping)
    record.siblings[record.id] = record
    central.memory.records[record.id] = record
    central.memory.record_bytes += record.size
    while central.memory.record_bytes > central.budget.records:  # drops the oldest first
        _drop(central, next(iter(central.memory.records.values())))


def _drop(central: State, record: TaskRecord) -> None:
    """Drop a record, and all under it."""
    record.siblings.pop(record.id)
    forgotten = [record]
    while forgotten:
        dropped = forgotten.pop()
        forgotten.extend(dropped.retention.records.values())
        del central.memory.records[dropped.id]
        central.memory.record_bytes -= dropped.size
        for module in dropped.retention.by:
            del module.retained[dropped.id]
            central.memory.retentions -= 1
        central.facts.append(facts.Released(dropped.id, ""))

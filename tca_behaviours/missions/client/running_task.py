"""The tasks of a server that run now, including those of other missions."""

from typing import Any

import msgspec

from tca_module import Sender, TaskInfo, TaskRef
from tca_wire.messages.formats import decode_untyped


class RunningTask(msgspec.Struct, frozen=True):
    """A task of a server that has not ended."""

    id: int
    name: str
    state: str
    """"waits", "runs", "suspended" or "is being stopped"."""
    parameters: dict[str, Any]
    """The parameters that its sender gave."""
    text: str = ""
    """The newest text that it has reported."""

    def __str__(self) -> str:
        given = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"{self.name}({given}) {{{self.id}}} {self.state}" + (
            f": {self.text}" if self.text else ""
        )


def running_tasks(sender: Sender, server: str) -> list[RunningTask]:
    """Return the tasks of a server that have not ended, oldest first."""
    prefix, found = f"{server}.", []
    for ref in sender.tasks():
        if ref.message.startswith(prefix) and (info := ref.info()) is not None:
            name, parameters = ref.message.removeprefix(prefix), given_parameters(info)
            found.append(RunningTask(info.id, name, _state(info), parameters, _newest_text(ref)))
    return sorted(found, key=lambda task: task.id)


def _state(info: TaskInfo) -> str:
    if info.killed:
        return "is being stopped"
    if info.suspended:
        return "suspended"
    return "runs" if info.module else "waits"


def given_parameters(info: TaskInfo) -> dict[str, Any]:
    """Return the parameters that the sender of a task gave."""
    data = decode_untyped(info.data)
    return data if isinstance(data, dict) else {}


def _newest_text(ref: TaskRef) -> str:
    """Return the text that a task has reported last."""
    progress = ref.progress()
    ref.state  # noqa: B018 - the earlier reports have arrived when central answers this
    reports = progress.arrived()
    return str(reports[-1].get("text", "")) if reports and isinstance(reports[-1], dict) else ""

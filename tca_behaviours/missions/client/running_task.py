"""The tasks of a server that run now, whoever has started them."""

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
    """Those that were given."""
    text: str = ""
    """What it says of itself."""

    def __str__(self) -> str:
        given = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"{self.name}({given}) {{{self.id}}} {self.state}" + (
            f": {self.text}" if self.text else ""
        )


def running_tasks(sender: Sender, server: str) -> list[RunningTask]:
    """The tasks of a server that have not ended, oldest first."""
    found = [
        _running(ref, server) for ref in sender.tasks() if ref.message.startswith(f"{server}.")
    ]
    return sorted((task for task in found if task is not None), key=lambda task: task.id)


def _running(ref: TaskRef, server: str) -> RunningTask | None:
    info = ref.info()
    if info is None:
        return None
    state = "suspended" if info.suspended else "runs" if info.module else "waits"
    return RunningTask(
        info.id,
        ref.message.removeprefix(f"{server}."),
        "is being stopped" if info.killed else state,
        given_parameters(info),
        _newest_text(ref),
    )


def given_parameters(info: TaskInfo) -> dict[str, Any]:
    """The parameters that a task was given."""
    data = decode_untyped(info.data)
    return data if isinstance(data, dict) else {}


def _newest_text(ref: TaskRef) -> str:
    """The text that a task has reported last."""
    said = ref.progress()
    ref.state  # noqa: B018 - when that is known, so is what was reported
    reports = said.arrived()
    return str(reports[-1].get("text", "")) if reports and isinstance(reports[-1], dict) else ""

"""An application as central knows it, kept up to date, and the way of commands to it."""

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import msgspec

from tca_activities.manager.messages import APPLICATION, ApplicationMessages
from tca_module import BadData, Command, MisuseError, Module, Task, TcaError, Timeout
from tca_module.client import Client

LOOK = 1.0
"""Seconds between two looks whether central and the application are there."""

PATIENCE = 20.0
"""Seconds that a command may last before the page is told that it goes on."""


class PageCommand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A message that a page sends, with its data."""

    message: str
    data: Any = None


def applications(client: Client) -> list[str]:
    """The names of those that central knows."""
    names = [one.name for one in client.messages() if one.message_class == "variable"]
    return sorted(name.removeprefix(APPLICATION) for name in names if name.startswith(APPLICATION))


class LiveApplication:
    """The newest values of an application's variables, as JSON has them, each with the number of its change."""

    def __init__(self, name: str, central: str | None) -> None:
        self.name = name
        self.messages = ApplicationMessages(name)
        self._module = Module("tca activities", central)
        self._parts: dict[str, tuple[int, Any]] = {}
        self._serial = 0
        self._changed = threading.Condition()
        self._is_over = False
        for part in ("application", "allocation", "states", "figures", "picture"):
            self._module.handles(getattr(self.messages, part))(self._taker(part))

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """A block in which it follows central."""
        watch = threading.Thread(target=self._watch, name="watch of the page", daemon=True)
        with self._module.running():
            watch.start()
            try:
                yield
            finally:
                self.stop()
        watch.join()

    def stop(self) -> None:
        """Let nobody wait for news any more."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def news(self, since: int, patience: float) -> dict[str, Any]:
        """What has changed since a change of that number; waits for something new."""
        with self._changed:
            self._changed.wait_for(lambda: self._serial > since or self._is_over, patience)
            if since > self._serial:  # of another server at this address
                since = 0
            parts = {part: value for part, (serial, value) in self._parts.items() if serial > since}
            return {"serial": self._serial, "parts": parts}

    def send(self, asked: PageCommand) -> str:
        """Have a command carried out; a sentence of what became of it. Raises TcaError."""
        message = self._module.declared(asked.message)
        if not isinstance(message, Command):
            raise MisuseError(f"{message.title} is no command: a page sends commands only")
        try:
            sent = self._module.command(message, asked.data)
        except BadData as error:
            raise MisuseError(str(error)) from None
        try:
            sent.result(timeout=PATIENCE)
        except Timeout:
            return f"{asked.message}: goes on"
        return f"{asked.message}: done"

    # --- inside -----------------------------------------------------------------------------------------------------

    def _taker(self, part: str) -> Any:
        def take(_task: Task, value: Any) -> None:
            self._put(part, msgspec.to_builtins(value))

        return take

    def _put(self, part: str, value: Any) -> None:
        with self._changed:
            if part in self._parts and self._parts[part][1] == value:
                return
            self._serial += 1
            self._parts[part] = self._serial, value
            self._changed.notify_all()

    def _watch(self) -> None:
        """Say what is lost, if anything is."""
        while not self._is_over:
            self._put("lost", self._lost())
            end = time.monotonic() + LOOK
            with self._changed:
                self._changed.wait_for(lambda: self._is_over or time.monotonic() >= end, LOOK)

    def _lost(self) -> str:
        try:
            names = [module.name for module in self._module.modules()]
        except TcaError as error:
            return f"central does not answer ({error})"
        _, entry = self._parts.get("application", (0, None))
        if entry is None or entry["module"] in names:
            return ""
        return f"the program of '{self.name}' has ended, or does not answer: module '{entry['module']}' is not connected"

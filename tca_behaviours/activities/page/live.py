"""An application as central knows it, kept up to date, and the way of commands to it."""

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import msgspec

from tca_behaviours.activities.manager.messages import APPLICATION, ApplicationMessages
from tca_module import (
    BadData,
    CentralLost,
    Client,
    Inform,
    MisuseError,
    Module,
    Task,
    TcaError,
    Timeout,
    connect,
)
from tca_module.link.opening import CentralAddress

COMMAND = "tca activities"
"""The name of its modules: notices do not tell of commands of people's."""

LOOK = 1.0
"""Seconds between two looks whether central and the application are there."""

SILENCE = 5.0
"""Seconds without a word of an application, which tells its figures once a second, until the page
says so.
"""

PATIENCE = 20.0
"""Seconds that a command may last before the page is told that it goes on."""


class PageCommand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A command or inform that a page sends, with its data."""

    message: str
    data: Any = None


def applications(client: Client) -> list[str]:
    """The names of those that central knows."""
    names = [one.name for one in client.messages() if one.message_class == "variable"]
    return sorted(name.removeprefix(APPLICATION) for name in names if name.startswith(APPLICATION))


class LiveApplication:
    """The newest values of an application's variables, as JSON has them, each with the number of
    its change.
    """

    def __init__(self, name: str, central: CentralAddress) -> None:
        self.name = name
        self.messages = ApplicationMessages(name)
        self._central = central
        self._module = Module(COMMAND, central)
        self._parts: dict[str, tuple[int, Any]] = {}
        self._serial = 0
        self._heard_at = 0.0
        self._changed = threading.Condition()
        self._over = threading.Event()
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
            self._over.set()
            self._changed.notify_all()

    def news(self, since: int, patience: float) -> dict[str, Any]:
        """What has changed since a change of that number; waits for something new."""
        with self._changed:
            self._changed.wait_for(lambda: self._serial > since or self._over.is_set(), patience)
            if since > self._serial:  # of another server at this address
                since = 0
            parts = {part: value for part, (serial, value) in self._parts.items() if serial > since}
            return {"serial": self._serial, "parts": parts}

    def send(self, asked: PageCommand) -> str:
        """Have a command carried out; a sentence of what became of it. Raises TcaError."""
        with connect(COMMAND, self._central, patience=PATIENCE) as client:
            message = client.declared(asked.message)
            try:
                if isinstance(message, Inform):
                    client.inform(message, asked.data)
                    return f"{asked.message}: sent"
                client.command(message, asked.data).result(timeout=PATIENCE)
            except BadData as error:
                raise MisuseError(str(error)) from None
            except Timeout:
                return f"{asked.message}: goes on"
        return f"{asked.message}: done"

    # --- inside -----------------------------------------------------------------------------------

    def _taker(self, part: str) -> Any:
        def take(_task: Task, value: Any) -> None:
            self._heard_at = time.monotonic()
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
        while not self._over.is_set():
            try:
                with connect(COMMAND, self._central, patience=LOOK) as client:
                    while not self._over.wait(LOOK):
                        self._put("lost", self._lost(client))
            except TcaError as error:
                self._put("lost", str(error))
                self._over.wait(LOOK)

    def _lost(self, client: Client) -> str:
        _, entry = self._parts.get("application", (0, None))
        if entry is None:
            return ""
        try:
            is_there = entry["module"] in [module.name for module in client.modules()]
        except (CentralLost, Timeout) as error:
            return str(error)  # the connection stays: central awaits it when it is back
        if not is_there:
            missing = f"module '{entry['module']}', which manages '{self.name}', is not connected"
            return f"{missing}: its program has ended, or stands still"
        if time.monotonic() > self._heard_at + SILENCE:
            return f"'{self.name}' has told nothing for more than {SILENCE:g} s: its program stands still, or is held up"
        return ""

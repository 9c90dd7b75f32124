"""The newest values of an application's variables, and the way to send commands to the
application.
"""

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
"""The name of the page's modules. Central sends no notices about modules of tools."""

CHECK_PERIOD = 1.0
"""Seconds between two checks whether central and the application are there."""

SILENCE = 5.0
"""Seconds without a report until the page shows that as a problem. An application sends figures
every second.
"""

PATIENCE = 20.0
"""Seconds that the page waits for the end of a command; then it shows "still running"."""


class PageCommand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A command or inform that a page sends, with its data."""

    message: str
    data: Any = None


def applications(client: Client) -> list[str]:
    """Return the names of the applications that central knows."""
    names = [each.name for each in client.messages() if each.message_class == "variable"]
    return sorted(name.removeprefix(APPLICATION) for name in names if name.startswith(APPLICATION))


class LiveApplication:
    """The newest values of an application's variables, as JSON.

    The changes of the values are numbered, so that a page can ask for all changes since its last
    request.
    """

    def __init__(self, name: str, central: CentralAddress) -> None:
        self.name = name
        self.messages = ApplicationMessages(name)
        self._central = central
        self._module = Module(COMMAND, central)
        #: For each variable, by name: the number of its last change, and its value.
        self._parts: dict[str, tuple[int, Any]] = {}
        self._serial = 0  #: the number of the newest change
        self._received_at = 0.0
        self._changed = threading.Condition()
        self._stopped = threading.Event()
        for part in ("application", "allocation", "states", "figures", "picture"):
            self._module.handles(getattr(self.messages, part))(self._receiver(part))

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """A block in which this object receives the variables from central."""
        watch = threading.Thread(target=self._watch, name="watch of the page", daemon=True)
        with self._module.running():
            watch.start()
            try:
                yield
            finally:
                self.stop()
        watch.join()

    def stop(self) -> None:
        """End all waits for changes."""
        with self._changed:
            self._stopped.set()
            self._changed.notify_all()

    def changes_since(self, since: int, patience: float) -> dict[str, Any]:
        """Return the values that have changed since change number *since*. Waits up to *patience*
        for a change.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._serial > since or self._stopped.is_set(), patience)
            if since > self._serial:  # the number comes from an earlier server at this address
                since = 0
            parts = {part: value for part, (serial, value) in self._parts.items() if serial > since}
            return {"serial": self._serial, "parts": parts}

    def send(self, command: PageCommand) -> str:
        """Send a command, wait for its end, and describe the outcome. Raises TcaError."""
        with connect(COMMAND, self._central, patience=PATIENCE) as client:
            message = client.declared(command.message)
            try:
                if isinstance(message, Inform):
                    client.inform(message, command.data)
                    return f"{command.message}: sent"
                client.command(message, command.data).result(timeout=PATIENCE)
            except BadData as error:
                raise MisuseError(str(error)) from None
            except Timeout:
                return f"{command.message}: still running"
        return f"{command.message}: done"

    # --- inside -----------------------------------------------------------------------------------

    def _receiver(self, part: str) -> Any:
        def receive(_task: Task, value: Any) -> None:
            self._received_at = time.monotonic()
            self._store(part, msgspec.to_builtins(value))

        return receive

    def _store(self, part: str, value: Any) -> None:
        with self._changed:
            if part in self._parts and self._parts[part][1] == value:
                return
            self._serial += 1
            self._parts[part] = self._serial, value
            self._changed.notify_all()

    def _watch(self) -> None:
        """Check regularly whether central and the application are there. If not, publish the
        problem.
        """
        while not self._stopped.is_set():
            try:
                with connect(COMMAND, self._central, patience=CHECK_PERIOD) as client:
                    while not self._stopped.wait(CHECK_PERIOD):
                        self._store("lost", self._problem(client))
            except TcaError as error:
                self._store("lost", str(error))
                self._stopped.wait(CHECK_PERIOD)

    def _problem(self, client: Client) -> str:
        """Return why the application sends no reports; "" if it does."""
        _, entry = self._parts.get("application", (0, None))
        if entry is None:
            return ""
        try:
            is_there = entry["module"] in [module.name for module in client.modules()]
        except (CentralLost, Timeout) as error:
            return str(error)  # keep the connection, which works again when central is back
        if not is_there:
            module = f"module '{entry['module']}', which manages '{self.name}'"
            return f"{module}, is not connected: its program has ended or hangs"
        if time.monotonic() > self._received_at + SILENCE:
            return (
                f"'{self.name}' has sent no report for more than {SILENCE:g} s: "
                "its program hangs or is delayed"
            )
        return ""

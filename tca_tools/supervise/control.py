"""The control socket of a running ``tca run``: others stop, start or restart single programs."""

import json
import os
import socketserver
import threading
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from socket import AF_UNIX, socket
from typing import Any, Self

from tca_tools.errors import ToolError
from tca_wire.endpoint import default_folder

Act = Callable[[str, list[str]], list[str]]
"""Carries out an action ("stop", "start", "restart") on programs. Returns lines for the user."""


def control_path(file: Path) -> Path:
    """Return the socket of the ``tca run`` of a robot's file."""
    return default_folder() / f"run-{sha256(str(file.resolve()).encode()).hexdigest()[:16]}.sock"


def ask(file: Path, action: str, names: list[str]) -> list[str]:
    """Have the running ``tca run`` of a file stop, start or restart programs.

    Returns lines for the user. Raises ToolError.
    """
    with socket(AF_UNIX) as line:
        try:
            line.connect(str(control_path(file)))
            line.sendall(json.dumps({"action": action, "names": names}).encode() + b"\n")
            reply = json.loads(line.makefile().readline() or "{}")
        except OSError:
            reply = {}
    if "lines" not in reply:
        why = reply.get("error") or f"no 'tca run' answers for {file}: start it first"
        raise ToolError(why)
    return list(reply["lines"])


class Control:
    """Answers ``ask`` in a thread, one request after the other, while a ``with`` block lasts.

    The folder of the socket belongs to the user, and only the user may enter it.
    """

    def __init__(self, file: Path, act: Act, report: Callable[[str], object]) -> None:
        self._path, self._act, self._report = control_path(file), act, report
        self._server: socketserver.UnixStreamServer | None = None

    def __enter__(self) -> Self:
        try:
            self._server = self._listen()
        except OSError as error:
            self._report(f"can't be controlled: {self._path}: {error.strerror or error}")
        else:
            threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._server is not None:
            self._path.unlink(missing_ok=True)
            self._server.shutdown()
            self._server.server_close()

    def _listen(self) -> socketserver.UnixStreamServer:
        """Return the listening socket. Raises OSError."""
        folder = self._path.parent
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if folder.stat().st_uid != os.getuid():
            raise OSError(f"{folder} belongs to another user")
        folder.chmod(0o700)
        with socket(AF_UNIX) as other, suppress(OSError):
            other.connect(str(self._path))
            raise OSError("another 'tca run' of this file runs")
        self._path.unlink(missing_ok=True)
        return socketserver.UnixStreamServer(str(self._path), _handler(self._act))


def _handler(act: Act) -> type[socketserver.StreamRequestHandler]:
    class Handler(socketserver.StreamRequestHandler):
        timeout = 5  # seconds in which a program that has connected sends its request

        def handle(self) -> None:
            reply: dict[str, Any] = {}
            with suppress(OSError, ValueError, KeyError):
                asked = json.loads(self.rfile.readline(1 << 16))
                try:
                    reply["lines"] = act(str(asked["action"]), list(asked["names"]))
                except ToolError as error:
                    reply["error"] = error.message
                self.wfile.write(json.dumps(reply).encode() + b"\n")

    return Handler

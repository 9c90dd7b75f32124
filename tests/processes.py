"""Real processes for tests: start, read and stop centrals and programs.

Python programs are forked from a process that has imported all packages. Otherwise a test with five
programs would import the same packages five times.
"""

import functools
import gc
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import IO, Any, Self

TESTS = Path(__file__).parent
SOON = 120.0
"""Seconds after which a process that should have ended, or printed a line, is killed."""


class Process:
    """A process ``python COMMAND...``, with pipes to its streams, or with *log* for its output.

    The class has the methods of ``subprocess.Popen``, and :meth:`hear`.
    """

    def __init__(
        self,
        *command: str,
        cwd: Path | None = None,
        log: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        ours, its = zip(*(_pipe(is_input=number == 0) for number in range(3)), strict=True)
        self.stdin, self.stdout, self.stderr = map(_text, ours, "wrr")
        files = list(its)
        if log is not None:
            files[1:] = [os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)] * 2
        self.returncode: int | None = None
        self.pid = _fork_server().start(command, files, {**os.environ, **(environment or {})}, cwd)
        for file in {*its, *files}:
            os.close(file)

    def hear(self, line: str) -> None:
        """Check the next line of output."""
        with self.killed_after(SOON):
            assert self.stdout.readline() == f"{line}\n"

    def poll(self) -> int | None:
        """Return the exit code, as ``os.waitstatus_to_exitcode``; None while the process runs."""
        if self.returncode is None:
            self.returncode = _fork_server().exit_code(self.pid)
        return self.returncode

    def wait(self, timeout: float = SOON) -> int:
        end = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(0.002)
        return code

    def communicate(self, text: str = "", timeout: float = SOON) -> tuple[str, str]:
        """Return the output until the process ends, from both streams, and close them."""
        if self.stdout.closed:
            return "", ""
        outputs: dict[IO[str], str] = {}
        readers = [
            threading.Thread(target=lambda one=one: outputs.update({one: one.read()}), daemon=True)
            for one in (self.stdout, self.stderr)
        ]
        with self.killed_after(timeout):
            for reader in readers:
                reader.start()
            with suppress(BrokenPipeError):
                self.stdin.write(text)
                self.stdin.close()
            for reader in readers:
                reader.join()
            self.wait(timeout)
        self._close_streams()
        return outputs[self.stdout], outputs[self.stderr]

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def close(self) -> None:
        """Kill the process, if it has not ended."""
        self.kill()
        self.wait()
        self._close_streams()

    def _close_streams(self) -> None:
        for stream in (self.stdin, self.stdout, self.stderr):
            with suppress(BrokenPipeError):
                stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def killed_after(self, seconds: float) -> Iterator[None]:
        too_late = threading.Timer(seconds, self.kill)
        too_late.start()
        try:
            yield
        finally:
            too_late.cancel()


def _text(file: int, mode: str) -> IO[str]:
    return os.fdopen(file, mode, buffering=1, errors="replace")


def _pipe(*, is_input: bool) -> tuple[int, int]:
    """Return a pipe: our end, and the process's end."""
    reads, writes = os.pipe()
    return (writes, reads) if is_input else (reads, writes)


class Central:
    """A running daemon. *command* runs another program than the daemon of this checkout."""

    def __init__(
        self, folder: Path, *options: str, bind: str = "", command: Sequence[str] = ()
    ) -> None:
        folder.mkdir(exist_ok=True)
        self.address = bind or f"ipc://{folder}/central.sock"
        self.journal = folder / "journal"
        if bind.startswith("tcp://") and "TCA_KEYS" not in os.environ:
            options = (*options, "--insecure")
        options = ("--bind", self.address, "--journal", str(self.journal), *options)
        self.process = Process(*(command or ("-m", "tca_central")), *options)
        self.first_line = "" if "--quiet" in options else self.process.stderr.readline().strip()

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()

    def facts(self, *kinds: type) -> list[Any]:
        """Return all facts of the journal, or those of the given kinds."""
        from tca_tools.journal.journals import open_log

        return [
            fact
            for entry in open_log(self.journal)
            for fact in entry.facts
            if isinstance(fact, kinds or object)
        ]

    def stop(self) -> str:
        """Stop the daemon. Return its log after the first line."""
        if self.process.poll() is None:
            self.process.terminate()
        return str(self.process.communicate(timeout=10)[1])


@contextmanager
def central(
    folder: Path, *options: str, bind: str = "", command: Sequence[str] = ()
) -> Iterator[Central]:
    running = Central(folder, *options, bind=bind, command=command)
    try:
        yield running
    finally:
        running.signal(signal.SIGCONT)
        running.stop()


def program(text: str, address: str, *words: str, cwd: Path | None = None) -> Process:
    """Run a Python program as a module's process."""
    return Process(
        "-c", textwrap.dedent(text), *words, cwd=cwd, environment={"TCA_CENTRAL": address}
    )


def run(*command: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Run ``python COMMAND...`` to its end."""
    with Process(*command, environment=environment) as running:
        output, errors = running.communicate()
        return subprocess.CompletedProcess(command, running.wait(), output, errors)


def tca(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run the command ``tca`` to its end."""
    return run("tca", *arguments)


# --- forking ----------------------------------------------------------------------------------------


class _ForkServer:
    """The process that forks other processes, and reports their exit codes."""

    def __init__(self) -> None:
        self._line, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with its:
            environment = {**os.environ, "PYTHONPATH": f"{TESTS}{os.pathsep}{TESTS.parent}"}
            self._process = subprocess.Popen(
                [sys.executable, __file__, str(its.fileno())],
                pass_fds=[its.fileno()],
                env=environment,
            )
        self._lock = threading.Lock()

    def close(self) -> None:
        self._line.close()
        self._process.wait()

    def _ask(self, words: dict[str, Any], files: Sequence[int] = ()) -> Any:
        with self._lock:
            socket.send_fds(self._line, [json.dumps(words).encode()], files)
            return json.loads(self._line.recv(100))

    def start(
        self,
        command: Sequence[str],
        files: Sequence[int],
        environment: dict[str, str],
        cwd: Path | None,
    ) -> int:
        """Start a process with these standard streams."""
        words = {"command": command, "environment": environment, "cwd": str(cwd or Path.cwd())}
        return int(self._ask(words, files))

    def exit_code(self, process: int) -> int | None:
        """Return the exit code of a process; None while it runs. The code can be read only once."""
        code: int | None = self._ask({"look": process})
        return code


@functools.cache
def _fork_server() -> _ForkServer:
    return _ForkServer()


def end() -> None:
    """Stop the forking process."""
    if _fork_server.cache_info().currsize:
        _fork_server().close()


def _serve_forks(line: socket.socket) -> list[str]:
    """Fork on each request. The function returns in new processes only, with their command."""
    while packet := socket.recv_fds(line, 1 << 20, 3):
        text, files, *_ = packet
        if not text:
            sys.exit()
        words = json.loads(text)
        if "look" in words:
            found, status = os.waitpid(words["look"], os.WNOHANG)
            line.send(json.dumps(os.waitstatus_to_exitcode(status) if found else None).encode())
        elif process := os.fork():
            line.send(json.dumps(process).encode())
            for file in set(files):
                os.close(file)
        else:
            line.close()
            for number, file in enumerate(files):
                os.dup2(file, number)
            os.closerange(3, max(files) + 1)
            os.chdir(words["cwd"])
            os.environ.clear()
            os.environ.update(words["environment"])
            sys.stdin, sys.stdout, sys.stderr = map(_text, range(3), "rww")
            return list(words["command"])
    raise AssertionError


def _become(command: list[str]) -> None:
    """Become ``python COMMAND...``, ``tca ...``, or the program at a path."""
    how, *words = command
    sys.argv = command
    if how == "-m":
        sys.argv = words
        runpy.run_module(words[0], run_name="__main__", alter_sys=True)
    elif how == "-c":
        sys.argv = [how, *words[1:]]
        exec(compile(words[0], "<string>", "exec"), {"__name__": "__main__"})
    elif how == "tca":
        import_module("tca_tools.command_line").main(words, prog_name="tca")
    elif how.endswith(".py"):
        sys.path.insert(0, str(Path(how).parent))
        runpy.run_path(how, run_name="__main__")
    else:
        os.execv(how, command)


PACKAGES = (
    "tca_central.__main__",
    "tca_module.testing",
    "tca_tools.command_line",
    "tca_tools.explore",
    "tca_tools.supervise.command",
)

if __name__ == "__main__":
    for name in PACKAGES:
        import_module(name)
    del sys.modules["tca_central.__main__"]  # the module runs as the main module later
    gc.freeze()
    _become(_serve_forks(socket.socket(fileno=int(sys.argv[1]))))

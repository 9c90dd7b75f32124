"""The guard: a process that ends programs when their starter is killed.

It is started as ``python guard.py GRACE STARTER``, and imports only the standard library to stay
small. Its standard input is a pipe from the starter. The kernel closes the pipe, however the
starter dies. Each program writes its process group into the pipe before it starts: ``+12 0``, or
``+7 1`` if the program ends last, as central does, or ``+7 2`` if it ends after central. The
starter writes ``-12`` when group 12 has ended.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

POLL_SECONDS = 0.05
"""Seconds between two checks of a group that must end."""
LAST_GRACE = 1.0
"""Seconds between SIGTERM and SIGKILL."""


def start_line(group: int, *, ends_last: int) -> bytes:
    """Return the line for the guard when a program starts."""
    return b"+%d %d\n" % (group, ends_last)


def end_line(group: int) -> bytes:
    """Return the line for the guard when a process group has ended."""
    return b"-%d\n" % group


def send(group: int, number: int) -> bool:
    """Send a signal to a process group. Return whether the group exists."""
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    except PermissionError:  # only zombies are left (macOS), or another user has the number now
        return False
    return True


def is_alive(group: int) -> bool:
    """Whether a process of a group lives. Zombies, common in containers, do not count."""
    return bool(_living([group]))


def _living(groups: Iterable[int]) -> set[int]:
    """Return the groups that have a living process."""
    groups = {group for group in groups if send(group, 0)}
    stats = list(Path("/proc").glob("[0-9]*/stat")) if groups else []
    return groups.intersection(filter(None, map(_group_of_living, stats))) if stats else groups


def _group_of_living(stat: Path) -> int:
    """Return the group of a process, from its file in /proc; 0 if it is dead."""
    try:
        state, _, group, *_ = stat.read_bytes().rpartition(b")")[2].split()
    except OSError:
        return 0
    return 0 if state in b"ZX" else int(group)


def ask_to_end(group: int, number: int) -> None:
    """Send a signal that ends a process group, even if SIGSTOP has stopped it."""
    send(group, number)
    send(group, signal.SIGCONT)


def stop_all(
    graces: Mapping[int, float],
    is_hurried: Callable[[], bool] = lambda: False,
    on_kill: Callable[[int], object] = lambda _: None,
) -> None:
    """End process groups: with SIGINT, so that Python programs clean up; then SIGTERM, SIGKILL.

    Args:
        graces: for each group, the seconds between SIGINT and SIGTERM.
        is_hurried: whether to kill at once.
        on_kill: is called with each group that did not end in time.
    """
    start, left, terminated = time.monotonic(), _living(graces), set[int]()
    pause = POLL_SECONDS / 64
    for group in left:
        ask_to_end(group, signal.SIGINT)
    while left:
        waited = time.monotonic() - start
        for group in sorted(left):
            if is_hurried() or waited > graces[group] + LAST_GRACE:
                on_kill(group)
                send(group, signal.SIGKILL)
                left.discard(group)
            elif waited > graces[group] and group not in terminated:
                ask_to_end(group, signal.SIGTERM)
                terminated.add(group)
        time.sleep(pause := min(2 * pause, POLL_SECONDS))  # most end at once
        left = _living(left)


def main() -> None:
    """Wait for the end of the starter, then end its remaining programs, central last."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: dict[int, bytes] = {}  #: b"1" for a group that ends last, b"2" for one after those
    for line in sys.stdin.buffer:
        group, *ends_last = line[1:].split()
        groups.pop(int(group), None)
        if ends_last:
            groups[int(group)] = ends_last[0]
    left = _living(groups)
    if left:
        print(
            f"tca: {sys.argv[2]} was killed; its {len(left)} programs are ended",
            file=sys.stderr,
            flush=True,
        )
    for stage in (b"0", b"1", b"2"):
        stop_all({group: float(sys.argv[1]) for group in left if groups[group] == stage})


if __name__ == "__main__":
    main()

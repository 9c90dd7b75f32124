"""The guard: ends programs when the process that has started them is killed.

A process of its own, started as ``python guard.py GRACE STARTER``; it imports only the standard
library, so it is small. Its standard input is a pipe whose other end the starter holds: the kernel
closes it, however the starter dies. Each program writes its own process group there before it
begins (``+12 0``; one that ends last, as central, ``+7 1``); the starter takes it back (``-12``)
when the group is gone.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

LOOK = 0.05
"""Seconds between two looks at a group that is to end."""
LAST_GRACE = 1.0
"""Seconds between SIGTERM and SIGKILL."""


def started(group: int, *, ends_last: bool) -> bytes:
    """The line of a program that begins."""
    return b"+%d %d\n" % (group, ends_last)


def gone(group: int) -> bytes:
    """The line of a process group that is gone."""
    return b"-%d\n" % group


def send(group: int, number: int) -> bool:
    """Send a signal to a process group; whether there is one."""
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    except PermissionError:  # only zombies are left (macOS), or it has become another user's
        return False
    return True


def is_alive(group: int) -> bool:
    """Whether a process of a group lives. The dead that nobody reaps, as in many containers, do not
    count.
    """
    return bool(_living([group]))


def _living(groups: Iterable[int]) -> set[int]:
    """Those of these groups of which a process lives."""
    groups = {group for group in groups if send(group, 0)}
    stats = list(Path("/proc").glob("[0-9]*/stat")) if groups else []
    return groups.intersection(filter(None, map(_group_of_living, stats))) if stats else groups


def _group_of_living(stat: Path) -> int:
    """The group of a process, by its file in /proc; 0 if it is dead."""
    try:
        state, _, group, *_ = stat.read_bytes().rpartition(b")")[2].split()
    except OSError:
        return 0
    return 0 if state in b"ZX" else int(group)


def ask_to_end(group: int, number: int) -> None:
    """Send a signal that ends a process group, also where it is stopped."""
    send(group, number)
    send(group, signal.SIGCONT)


def end_all(
    graces: Mapping[int, float],
    is_hurried: Callable[[], bool] = lambda: False,
    on_kill: Callable[[int], object] = lambda _: None,
) -> None:
    """End process groups, politely first: SIGINT lets a Python program clean up.

    Args:
        graces: for each group the seconds between SIGINT and SIGTERM.
        is_hurried: whether to wait no longer.
        on_kill: is told a group that did not end in time.
    """
    began, left, terminated, pause = time.monotonic(), _living(graces), set[int](), LOOK / 64
    for group in left:
        ask_to_end(group, signal.SIGINT)
    while left:
        waited = time.monotonic() - began
        for group in sorted(left):
            if is_hurried() or waited > graces[group] + LAST_GRACE:
                on_kill(group)
                send(group, signal.SIGKILL)
                left.discard(group)
            elif waited > graces[group] and group not in terminated:
                ask_to_end(group, signal.SIGTERM)
                terminated.add(group)
        time.sleep(pause := min(2 * pause, LOOK))  # most end at once
        left = _living(left)


def main() -> None:
    """Wait for the end of the starter, and end what it has left: central last."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: dict[int, bytes] = {}  #: and whether each ends last
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
    for now in (b"0", b"1"):
        end_all({group: float(sys.argv[1]) for group in left if groups[group] == now})


if __name__ == "__main__":
    main()

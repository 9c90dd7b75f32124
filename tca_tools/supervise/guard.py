"""The guard: ends the programs of a robot when ``tca run`` itself is killed.

A process of its own, started as ``python guard.py GRACE``; it imports only the standard library, so it is small. Its
standard input is a pipe whose other end ``tca run`` holds: the kernel closes it, however ``tca run`` dies. Each program
writes its own process group there before it begins (``+12 0``; central ``+7 1``); ``tca run`` takes it back (``-12``)
when the group is gone.
"""

import os
import signal
import sys
import time
from pathlib import Path

LOOK = 0.05
"""Seconds between two looks at a group that is to end."""
LAST_GRACE = 1.0
"""Seconds between SIGTERM and SIGKILL."""


def started(group: int, *, is_central: bool) -> bytes:
    """The line of a program that begins."""
    return b"+%d %d\n" % (group, is_central)


def gone(group: int) -> bytes:
    """The line of a process group that is gone."""
    return b"-%d\n" % group


def groups_left(lines: list[bytes]) -> dict[int, bool]:
    """The groups that are there still, and whether each is central's."""
    left: dict[int, bool] = {}
    for line in lines:
        words = line[1:].split()
        if line.startswith(b"+"):
            left[int(words[0])] = words[1] == b"1"
        else:
            left.pop(int(words[0]), None)
    return left


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
    """Whether a process of a group lives. The dead that nobody reaps, as in many containers, do not count."""
    if not send(group, 0):
        return False
    stats = list(Path("/proc").glob("[0-9]*/stat"))
    return not stats or any(_is_alive_in(stat, group) for stat in stats)


def _is_alive_in(stat: Path, group: int) -> bool:
    try:
        state, _, its_group, *_ = stat.read_bytes().rpartition(b")")[2].split()
    except OSError:
        return False
    return int(its_group) == group and state not in b"ZX"


def ask_to_end(group: int, number: int) -> None:
    """Send a signal that ends a process group, also where it is stopped."""
    send(group, number)
    send(group, signal.SIGCONT)


def end_all(groups: list[int], grace: float) -> None:
    """End process groups, politely first: SIGINT lets a Python program clean up."""
    for number, patience in ((signal.SIGINT, grace), (signal.SIGTERM, LAST_GRACE)):
        groups = [group for group in groups if is_alive(group)]
        for group in groups:
            ask_to_end(group, number)
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline and any(map(is_alive, groups)):
            time.sleep(LOOK)
    for group in groups:
        send(group, signal.SIGKILL)


def main() -> None:
    """Wait for the end of ``tca run``, and end what it has left: modules first."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    lines: list[bytes] = []
    for line in sys.stdin.buffer:
        lines.append(line)
        if line.startswith(b"-"):
            lines = [started(group, is_central=central) for group, central in groups_left(lines).items()]
    left = {group: is_central for group, is_central in groups_left(lines).items() if is_alive(group)}
    if left:
        print(f"tca: 'tca run' was killed; its {len(left)} programs are ended", file=sys.stderr, flush=True)
    end_all([group for group, is_central in left.items() if not is_central], float(sys.argv[1]))
    end_all([group for group, is_central in left.items() if is_central], float(sys.argv[1]))


if __name__ == "__main__":
    main()

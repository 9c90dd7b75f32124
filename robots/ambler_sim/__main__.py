"""The walk: central, the Ambler's modules and the simulator, each a process; then the pictures of
the run.
"""

import argparse
import fcntl
import os
import shutil
import sys
import time
from pathlib import Path

from robots.ambler_sim.machine.making import WITHOUT_PHYSICS, pybullet_is_installed, why_no_window
from robots.ambler_sim.options import walk_options
from robots.ambler_sim.pictures.film import why_no_film
from robots.ambler_sim.run.walk import Walk, console
from robots.show import shown

MARKER = ".ambler-walk"
"""A file by which a folder is known to hold a walk, and locked while the walk goes on."""


def main() -> int:
    """The command line; the exit code."""
    return shown(walk_options(description=__doc__), _walk)


def _walk(options: argparse.Namespace) -> int:
    if options.gui and (missing := without_physics(options) or why_no_window()):
        raise SystemExit(f"ambler: --gui: {missing}")
    if options.film and (missing := without_physics(options) or why_no_film(options.film)):
        raise SystemExit(f"ambler: --film: {missing}")
    console.print(f"The Ambler walks {options.metres:g} m {_how(options)}.")
    began = time.monotonic()
    walk = Walk(options, sys.argv[1:], _fresh(options.out))
    tca = "tca" if shutil.which("tca") else Path(sys.executable).with_name("tca")
    look = f"{tca} view {walk.folder}/journal"
    console.print(f"Watch it in the browser: [bold]{look}[/bold]", soft_wrap=True)
    code = walk.run()
    console.print(f"{'Ended' if code else 'Done'} after {time.monotonic() - began:.0f} s:")
    for line in walk.judge().lines():
        console.print(f"  {line}", soft_wrap=True)
    for title, path in walk.outputs:
        console.print(f"  {title:12} {path}", soft_wrap=True)
    console.print(f"Look at any moment again, in the browser: [bold]{look}[/bold]", soft_wrap=True)
    return code


def _how(options: argparse.Namespace) -> str:
    pace = f"{options.pace:g} times as fast as in reality" if options.pace else "as fast as can be"
    if options.backend not in WITHOUT_PHYSICS and pybullet_is_installed():
        return f"with PyBullet's physics, {pace}"
    missing = "" if pybullet_is_installed() else " (no PyBullet here)"
    return f"kinematically, without physics{missing}, {pace}"


def _fresh(folder: Path) -> Path:
    """An empty folder, where only an earlier walk may have been; it is locked for as long as this
    process lives.
    """
    marker = folder / MARKER
    if folder.exists() and any(folder.iterdir()) and not marker.exists():
        raise SystemExit(
            f"ambler: {folder} holds something else than a walk: name another folder with --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    try:
        fcntl.flock(
            os.open(marker, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644),
            fcntl.LOCK_EX | fcntl.LOCK_NB,
        )
    except BlockingIOError:
        raise SystemExit(
            f"ambler: another walk is going on in {folder}: name another folder with --out"
        ) from None
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path != marker:
            path.unlink()
    return folder.resolve()


def without_physics(options: argparse.Namespace) -> str:
    """Why this walk has no camera and no window; empty: it has physics, in which there are both."""
    if options.backend in WITHOUT_PHYSICS:
        return f"the {options.backend} backend has no physics to look at: leave --backend out"
    return "" if pybullet_is_installed() else "it needs PyBullet, which is not installed here"


if __name__ == "__main__":
    sys.exit(main())

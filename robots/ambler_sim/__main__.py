"""Walk the Ambler: run central, its modules and the simulator as processes; then draw the run."""

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
from robots.show import run_show

MARKER = ".ambler-walk"
"""A file that marks a folder as holding a walk. The running walk has it locked."""


def main() -> int:
    """Run the command line. Returns the exit code."""
    return run_show(walk_options(description=__doc__), _walk)


def _walk(options: argparse.Namespace) -> int:
    if options.gui and (reason := why_no_physics(options) or why_no_window()):
        raise SystemExit(f"ambler: --gui: {reason}")
    if options.film and (reason := why_no_physics(options) or why_no_film(options.film)):
        raise SystemExit(f"ambler: --film: {reason}")
    console.print(f"The Ambler walks {options.metres:g} m {_simulation_and_pace(options)}.")
    began = time.monotonic()
    walk = Walk(options, sys.argv[1:], _prepared_folder(options.out))
    tca = "tca" if shutil.which("tca") else Path(sys.executable).with_name("tca")
    view = f"{tca} view {walk.folder}/journal"
    console.print(f"Watch it in the browser: [bold]{view}[/bold]", soft_wrap=True)
    code = walk.run()
    console.print(f"{'Ended' if code else 'Done'} after {time.monotonic() - began:.0f} s:")
    for line in walk.save_figures().lines():
        console.print(f"  {line}", soft_wrap=True)
    for title, path in walk.outputs:
        console.print(f"  {title:12} {path}", soft_wrap=True)
    console.print(f"See any moment again in the browser: [bold]{view}[/bold]", soft_wrap=True)
    return code


def _simulation_and_pace(options: argparse.Namespace) -> str:
    times = f"{options.pace:g} times as fast as in reality"
    pace = times if options.pace else "as fast as possible"
    if options.backend not in WITHOUT_PHYSICS and pybullet_is_installed():
        return f"with PyBullet's physics, {pace}"
    missing = "" if pybullet_is_installed() else " (no PyBullet here)"
    return f"kinematically, without physics{missing}, {pace}"


def _prepared_folder(folder: Path) -> Path:
    """Empty a walk's folder, and lock it until this process ends. Returns its absolute path."""
    marker = folder / MARKER
    if folder.exists() and any(folder.iterdir()) and not marker.exists():
        raise SystemExit(
            f"ambler: {folder} holds files that are not a walk's: name another folder with --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    try:
        fcntl.flock(
            os.open(marker, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644),
            fcntl.LOCK_EX | fcntl.LOCK_NB,
        )
    except BlockingIOError:
        raise SystemExit(
            f"ambler: another walk is running in {folder}: name another folder with --out"
        ) from None
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path != marker:
            path.unlink()
    return folder.resolve()


def why_no_physics(options: argparse.Namespace) -> str:
    """Return why this walk has no physics, and so no camera and no window; empty if it has
    physics.
    """
    if options.backend in WITHOUT_PHYSICS:
        return f"the {options.backend} backend has no physics to look at: leave --backend out"
    return "" if pybullet_is_installed() else "it needs PyBullet, which is not installed here"


if __name__ == "__main__":
    sys.exit(main())

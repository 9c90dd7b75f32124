"""What the processes of a life do."""

import logging
from collections.abc import Callable
from pathlib import Path

from chaos import robot

from tca_central.__main__ import central
from tca_central.shell import images


def be_central(folder: Path, events_between: str) -> None:
    """``tca central`` that takes an image of its state often."""
    images.EVENTS_BETWEEN = int(events_between)
    central(["--journal", str(folder / "journal")], prog_name="tca central")


def be_module(folder: Path, name: str) -> None:
    """A module of the robot."""
    logging.basicConfig(format="%(asctime)s %(process)d %(message)s", level=logging.INFO)
    robot.serve(name, folder)


def be_user(folder: Path, name: str, seed: str) -> None:
    """Somebody who uses it."""
    logging.basicConfig(format="%(asctime)s %(process)d %(message)s", level=logging.INFO)
    robot.use(name, folder, int(seed))


DEEDS: dict[str, Callable[..., None]] = {"central": be_central, "module": be_module, "user": be_user}

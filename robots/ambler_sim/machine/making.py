"""How to get a robot: with physics where it can be had, else without."""

import importlib.util
import os
import sys

from robots.ambler_sim.machine.kinematic import KinematicPlant
from robots.ambler_sim.machine.plant import Plant, standing_posture
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.options import Backend
from robots.ambler_sim.vocabulary import ORIGIN, Pose, Posture, Snapshot, TerrainSpec

WITHOUT_PHYSICS = ("kinematic", "graphical")


def make_robot(
    backend: Backend = "auto",
    *,
    terrain: TerrainSpec | None = None,
    pace: float = 0.0,
    state: Snapshot | None = None,
    start: Pose = ORIGIN,
    window: bool = False,
) -> Robot:
    """A robot standing at *start* on new ground, or where the snapshot *state* left it (whose
    terrain then counts).

    "auto" takes the backend of *state* if that can be had, else PyBullet if it is installed, else
    the kinematic one. With *window* physics is shown in one.
    """
    ground = Terrain(state.terrain if state else terrain or TerrainSpec())
    posture = state.posture if state else standing_posture(ground, start)
    plant = _make_plant(_chosen(backend, state), ground, posture, window=window)
    return Robot(plant, ground, pace=pace, state=state)


def pybullet_is_installed() -> bool:
    """PyBullet has wheels for few platforms only."""
    return importlib.util.find_spec("pybullet") is not None


def why_no_window() -> str:
    """What is missing here for a window; empty: nothing."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        return "it needs a screen, and there is none here: $DISPLAY is not set"
    return ""


def _chosen(backend: Backend, state: Snapshot | None) -> str:
    if backend != "auto":
        return backend
    wanted = state.backend if state else "pybullet"
    return wanted if wanted in WITHOUT_PHYSICS or pybullet_is_installed() else "kinematic"


def _make_plant(backend: str, terrain: Terrain, posture: Posture, *, window: bool) -> Plant:
    if backend in WITHOUT_PHYSICS:
        return KinematicPlant(terrain, posture, backend)
    from robots.ambler_sim.machine import physics  # noqa: PLC0415 - it needs PyBullet, which may not be installed

    return (
        physics.BulletWindow(terrain, posture) if window else physics.BulletPlant(terrain, posture)
    )

"""Make a robot: with physics if PyBullet is installed, else without."""

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
    """Make a robot that stands at *start* on new ground, or where the snapshot *state* left it.

    Args:
        backend: "auto" takes the backend of *state*. Without *state* it takes PyBullet. If PyBullet
            is not installed, it takes the kinematic backend instead.
        terrain: the ground; ignored with *state*, which contains the ground.
        pace: simulated time as a multiple of real time; 0 is as fast as possible.
        state: the snapshot of another process.
        start: the pose on new ground.
        window: show the physics in a window.
    """
    ground = Terrain(state.terrain if state else terrain or TerrainSpec())
    posture = state.posture if state else standing_posture(ground, start)
    plant = _make_plant(_chosen_backend(backend, state), ground, posture, window=window)
    return Robot(plant, ground, pace=pace, state=state)


def pybullet_is_installed() -> bool:
    """Return whether PyBullet is installed; it has wheels for few platforms only."""
    return importlib.util.find_spec("pybullet") is not None


def why_no_window() -> str:
    """Return why no window can be opened here; empty if one can."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        return "it needs a screen, and there is none here: $DISPLAY is not set"
    return ""


def _chosen_backend(backend: Backend, state: Snapshot | None) -> str:
    if backend != "auto":
        return backend
    wanted = state.backend if state else "pybullet"
    return wanted if wanted in WITHOUT_PHYSICS or pybullet_is_installed() else "kinematic"


def _make_plant(backend: str, terrain: Terrain, posture: Posture, *, window: bool) -> Plant:
    if backend in WITHOUT_PHYSICS:
        return KinematicPlant(terrain, posture, backend)
    # It imports PyBullet, which may not be installed.
    from robots.ambler_sim.machine import physics  # noqa: PLC0415

    kind = physics.BulletWindow if window else physics.BulletPlant
    return kind(terrain, posture)

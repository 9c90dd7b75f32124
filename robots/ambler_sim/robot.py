"""A robot as the rest of the program sees it, and how to get one: with physics where it can be had, else without."""

import importlib
import importlib.util
from pathlib import Path
from typing import Literal, Protocol

from robots.ambler_sim.controller import Ambler
from robots.ambler_sim.geometry import Array
from robots.ambler_sim.kinematic import KinematicPlant
from robots.ambler_sim.pacing import OnTick
from robots.ambler_sim.plant import Plant, standing_posture
from robots.ambler_sim.terrain import Terrain, make_terrain
from robots.ambler_sim.vocabulary import (
    BodyMove,
    Footfall,
    LegMove,
    Pose,
    Posture,
    Readings,
    Snapshot,
    Stance,
    TerrainSpec,
)

Backend = Literal["auto", "pybullet", "kinematic"]
START = Pose(0.0, 0.0, 0.0, 0.0)


class Robot(Protocol):
    """What controller modules may do with the robot. Not safe for use from several threads at once."""

    terrain: Terrain
    pace: float

    @property
    def backend(self) -> str:
        """Which simulator moves the robot."""

    @property
    def time(self) -> float:
        """Simulated seconds."""

    @property
    def peak_tilt(self) -> float:
        """The greatest inclination (rad) so far."""

    def stance(self) -> Stance:
        """The body pose and the six feet as measured now."""

    def readings(self) -> Readings:
        """Inclinometers and foot force sensors."""

    def move_leg(self, move: LegMove, on_tick: OnTick | None = None) -> Footfall:
        """Carry out a leg move; raises TerrainContact when the leg met something on its way."""

    def move_body(self, move: BodyMove, on_tick: OnTick | None = None) -> Pose:
        """Carry the body to a pose over standing feet."""

    def scan(self) -> Array:
        """World points (n, 3) of one sweep of the range scanner."""

    def picture(self, path: str | Path) -> Path:
        """Draw the robot where it is now."""

    def state(self) -> Snapshot:
        """What another process needs to go on from here."""

    def close(self) -> None:
        """Free the simulator."""


def make_robot(
    backend: Backend = "auto",
    *,
    terrain: TerrainSpec | None = None,
    pace: float = 0.0,
    state: Snapshot | None = None,
    start: Pose = START,
) -> Robot:
    """A robot standing at *start* on new ground, or where the snapshot *state* left it (whose terrain then counts).

    "auto" takes the backend of *state* if that can be had, else PyBullet if it is installed, else the kinematic one.
    """
    ground = make_terrain(state.terrain if state else terrain or TerrainSpec())
    posture = state.posture if state else standing_posture(ground, start)
    plant = _make_plant(_chosen(backend, state), ground, posture)
    return Ambler(plant, ground, pace=pace, state=state)


def pybullet_is_installed() -> bool:
    """PyBullet has wheels for few platforms only."""
    return importlib.util.find_spec("pybullet") is not None


def _chosen(backend: Backend, state: Snapshot | None) -> str:
    if backend != "auto":
        return backend
    wanted = state.backend if state else "pybullet"
    return wanted if wanted == "kinematic" or pybullet_is_installed() else "kinematic"


def _make_plant(backend: str, terrain: Terrain, posture: Posture) -> Plant:
    if backend == "kinematic":
        return KinematicPlant(terrain, posture)
    # Imported late: the module needs PyBullet, which may not be installed.
    physics = importlib.import_module("robots.ambler_sim.physics")
    plant: Plant = physics.BulletPlant(terrain, posture)
    return plant

"""A physics world of PyBullet: its functions, a robot in it, and pictures of it."""

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pybullet

from robots.rendering import Camera, Rendering

GRAVITY = 9.81


class Engine:
    """The functions of PyBullet, bound to one physics world."""

    def __init__(self, mode: int, tick: float, **options: Any) -> None:
        self._world = pybullet.connect(mode, **options)
        self.setGravity(0, 0, -GRAVITY)
        self.setPhysicsEngineParameter(fixedTimeStep=tick)

    def __getattr__(self, name: str) -> Any:
        """Bind the function of this name; later accesses find the attribute."""
        function = partial(getattr(pybullet, name), physicsClientId=self._world)
        setattr(self, name, function)
        return function


class BulletWorld:
    """A separate physics world with a robot in it."""

    _robot: int
    _sun: tuple[float, float, float]
    _ambient: float

    def __init__(self, tick: float) -> None:
        self._engine = self.connect(tick)

    def connect(self, tick: float) -> Engine:
        """Open a new physics world, without a window."""
        return Engine(pybullet.DIRECT, tick)

    def close(self) -> None:
        """Free the physics world."""
        self._engine.disconnect()

    def _load(self, urdf: str, *, is_fixed: bool = False) -> int:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "robot.urdf")
            file.write_text(urdf, encoding="utf-8")
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            robot: int = self._engine.loadURDF(str(file), useFixedBase=is_fixed, flags=flags)
        return robot

    def _joint_numbers(self) -> dict[str, int]:
        count = self._engine.getNumJoints(self._robot)
        infos = [self._engine.getJointInfo(self._robot, joint) for joint in range(count)]
        return {info[1].decode(): info[0] for info in infos}

    def _render(
        self, camera: Camera, size: tuple[int, int], ground_bodies: Sequence[int]
    ) -> Rendering:
        """Return the image of a camera: colours, depths, and masks of the ground and of objects on
        it.
        """
        width, height = size
        view = pybullet.computeViewMatrix(camera.eye, camera.target, (0, 0, 1))
        lens = pybullet.computeProjectionMatrixFOV(
            camera.angle, width / height, camera.near, camera.far
        )
        image = self._engine.getCameraImage(
            *(width, height, view, lens),
            shadow=0,  # the engine's shadows are coarse, and darken parts of a large ground
            lightDirection=self._sun,
            lightAmbientCoeff=self._ambient,
            lightDiffuseCoeff=0.5,
            lightSpecularCoeff=0.05,
            renderer=pybullet.ER_TINY_RENDERER,
        )
        colours, depths, bodies = (np.array(part).reshape(height, width, -1) for part in image[2:])
        to_screen = np.array(lens).reshape(4, 4).T @ np.array(view).reshape(4, 4).T
        bodies = bodies[..., 0]
        ground = np.isin(bodies, ground_bodies)
        rgb = colours.astype(np.uint8)[..., :3]
        return Rendering(rgb, depths[..., 0], ground, ~ground & (bodies >= 0), to_screen, camera)

"""An animated picture of a walk: Pillow joins photographs taken while the robot moves."""

import importlib.util
from pathlib import Path

from robots.ambler_sim.machine.robot import Robot

SIZE = (480, 300)
FRAME_PERIOD = 0.25
"""Seconds of the robot's time between two frames."""

FRAMES_PER_SECOND = 25
QUALITY = 45
"""The quality of WebP files, 0 to 100."""

FRAMES = "frames"
"""The folder of photographs, within the walk's folder."""

ENDINGS = (".gif", ".png", ".webp")


class FilmCamera:
    """Photographs a robot while it moves, from its footstep *first* on, into a folder."""

    def __init__(self, robot: Robot, folder: Path, first: int) -> None:
        self._robot, self._folder, self._first = robot, folder, first
        self._due = 0.0

    def tick(self) -> None:
        """Take a photograph at a tick of a move, if one is due."""
        now = self._robot.time
        if self._robot.footsteps >= self._first and now >= self._due:
            self._due = now + FRAME_PERIOD
            self._folder.mkdir(exist_ok=True)
            self._robot.picture(self._folder / f"{round(now * 1000):010d}.png", SIZE)


def why_no_film(file: Path) -> str:
    """Return why no film can be made; empty if it can."""
    if file.suffix not in ENDINGS:
        return f"{file} should end in one of {', '.join(ENDINGS)}"
    if importlib.util.find_spec("PIL") is None:
        return "it needs Pillow, which is not installed here"
    return ""


def join_frames(folder: Path, file: Path) -> int:
    """Join a folder's photographs to a film, if there are any. Returns their number."""
    import PIL.Image  # noqa: PLC0415 - it may not be installed

    frames: list[PIL.Image.Image] = []
    for path in sorted(folder.glob("*.png")):
        with PIL.Image.open(path) as frame:
            frames.append(frame.copy())
    if frames:
        frames[0].save(
            file,
            save_all=True,
            append_images=frames[1:],
            duration=1000 // FRAMES_PER_SECOND,
            loop=0,
            quality=QUALITY,
            method=4,
        )
    return len(frames)

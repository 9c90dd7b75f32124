"""A film of a walk: the times of its frames, and their order."""

from pathlib import Path

import numpy as np
import pytest

from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.machine.robot import Robot
from robots.ambler_sim.pictures.film import (
    FRAME_PERIOD,
    FRAMES_PER_SECOND,
    SIZE,
    FilmCamera,
    join_frames,
)
from robots.rendering import write_png

PIL_IMAGE = pytest.importorskip("PIL.Image")


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    """Return a robot whose pictures are all alike."""
    robot = make_robot("kinematic")

    def picture(path: Path, size: tuple[int, int]) -> Path:
        path.write_text(f"{size}")
        return path

    monkeypatch.setattr(robot, "picture", picture)
    return robot


def test_film_frames_follow_robot_time_from_first_footstep(robot: Robot, tmp_path: Path) -> None:
    camera = FilmCamera(robot, tmp_path / "frames", first=2)
    robot.time = 5.0
    camera.tick()
    assert list(tmp_path.iterdir()) == []
    robot.footsteps = 2
    for _ in range(5):
        camera.tick()
        robot.time += FRAME_PERIOD / 2
    frames = sorted((tmp_path / "frames").iterdir())
    assert [frame.name for frame in frames] == [
        "0000005000.png",
        "0000005250.png",
        "0000005500.png",
    ]
    assert frames[0].read_text() == f"{SIZE}"


@pytest.mark.parametrize("ending", ["webp", "gif", "png"])
def test_film_frames_are_joined_in_order(tmp_path: Path, ending: str) -> None:
    for number, gray in ((3, 250), (1, 10), (2, 130)):
        write_png(tmp_path / f"{number:010d}.png", np.full((6, 8, 3), gray, dtype=np.uint8))
    file = tmp_path / f"film.{ending}"
    assert join_frames(tmp_path, file) == 3
    with PIL_IMAGE.open(file) as film:
        grays = []
        for number in range(film.n_frames):
            film.seek(number)
            grays.append(film.convert("L").getpixel((4, 3)))
        assert film.size == (8, 6)
        assert grays == pytest.approx([10, 130, 250], abs=4)
        assert film.info["duration"] == 1000 / FRAMES_PER_SECOND


def test_no_film_is_written_without_frames(tmp_path: Path) -> None:
    assert join_frames(tmp_path / "none", tmp_path / "film.webp") == 0
    assert not (tmp_path / "film.webp").exists()

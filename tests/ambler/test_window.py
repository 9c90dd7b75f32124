"""Walks in a window or on film: impossible options are refused before anything starts."""

import sys
from pathlib import Path

import pytest

from robots.ambler_sim import __main__ as walk

NO_SCREEN = "--gui: it needs a screen, and there is none here: $DISPLAY is not set"
NO_ENGINE = "--gui: it needs PyBullet, which is not installed here"
NO_PHYSICS = "the kinematic backend has no physics to look at: leave --backend out"


@pytest.mark.parametrize(
    ("options", "has_engine", "display", "told"),
    [
        (["--gui"], True, "", NO_SCREEN),
        (["--gui"], False, ":0", NO_ENGINE),
        (["--gui", "--backend", "kinematic"], True, ":0", f"--gui: {NO_PHYSICS}"),
        (["--film", "walk.gif", "--backend", "kinematic"], True, "", f"--film: {NO_PHYSICS}"),
        (
            ["--film", "walk.mp4"],
            True,
            "",
            "--film: walk.mp4 should end in one of .gif, .png, .webp",
        ),
    ],
)
def test_walk_without_a_usable_display_is_refused(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    options: list[str],
    has_engine: bool,
    display: str,
    told: str,
) -> None:
    monkeypatch.setattr(walk, "pybullet_is_installed", lambda: has_engine)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setattr(sys, "argv", ["ambler", "--out", str(tmp_path / "walk"), *options])
    with pytest.raises(SystemExit) as refused:
        walk.main()
    assert str(refused.value) == f"ambler: {told}"
    assert not (tmp_path / "walk").exists()

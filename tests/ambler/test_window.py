"""Physics in a window: why there is none is said before anything is started."""

import sys
from pathlib import Path

import pytest

from robots.ambler_sim import __main__ as walk


def refusal(monkeypatch: pytest.MonkeyPatch, folder: Path, *options: str) -> str:
    """What a walk in a window is refused with, when nothing has been started and written yet."""
    monkeypatch.setattr(sys, "argv", ["ambler", "--gui", "--out", str(folder), *options])
    with pytest.raises(SystemExit) as refused:
        walk.main()
    assert not folder.exists()
    return str(refused.value)


def test_without_a_screen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(walk, "pybullet_is_installed", lambda: True)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    told = refusal(monkeypatch, tmp_path / "walk")
    assert told == "ambler: --gui: it needs a screen, and there is none here: $DISPLAY is not set"


def test_without_the_engine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(walk, "pybullet_is_installed", lambda: False)
    monkeypatch.setenv("DISPLAY", ":0")
    told = refusal(monkeypatch, tmp_path / "walk")
    assert told == "ambler: --gui: it needs PyBullet, which is not installed here"


def test_without_physics(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(walk, "pybullet_is_installed", lambda: True)
    monkeypatch.setenv("DISPLAY", ":0")
    told = refusal(monkeypatch, tmp_path / "walk", "--backend", "kinematic")
    assert told == "ambler: --gui: the kinematic backend has no physics to look at: leave --backend out"

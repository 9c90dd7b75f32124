"""The mission of example 81 also resumes after a kill."""

import runpy
from pathlib import Path

import pytest
from module.real_central import RealCentral

EXAMPLE = Path(__file__).parents[2] / "examples/81_mission_steps.py"
KILLED_IN_ROUND_1 = """\
{"steps_of":"patrol","version":2}
{"step":"clean","is":"done"}
{"step":"patrol","is":"begun"}
{"step":"gate 1","is":"done"}
{"step":"pond 1","is":"begun"}
"""


@pytest.mark.slow
def test_killed_patrol_resumes_and_ends_by_rain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = runpy.run_path(str(EXAMPLE))
    steps = tmp_path / "patrol.steps"
    steps.write_text(KILLED_IN_ROUND_1)
    camera = names["Camera"]()
    camera.film = 10
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        monkeypatch.setenv("TCA_CENTRAL", daemon.address)
        tasks = [names["Photograph"], names["WaitForRain"]]
        with names["TaskServer"]("camera", camera, tasks=tasks).running():
            names["run"](steps)
    places = ["pond 1", "gate 2", "pond 2", "gate 3"]
    printed = [f"photograph {place}" for place in places]
    assert capsys.readouterr().out.splitlines() == [*printed, "patrol: it rains"]
    assert not steps.exists()

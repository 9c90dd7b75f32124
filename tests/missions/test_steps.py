"""Steps of missions are done once, even if the program dies. A checkpoint file records them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, date, datetime
from functools import partial
from math import inf, nan
from pathlib import Path
from typing import Any, cast

import pytest
from missions.rover import Rover, rover

from tca_behaviours.missions import Mission, MissionTaskFailed, Status, StepUncertain, TaskEnd
from tca_module import MisuseError
from tca_module.testing import LocalCentral


class Trip:
    """Consecutive runs of one program."""

    def __init__(self, central: LocalCentral, robot: Rover, file: Path) -> None:
        self.central, self.robot, self.file = central, robot, file

    def mission(self, **options: Any) -> Mission:
        return Mission("rover", name="trip", central=self.central, checkpoint=self.file, **options)


class Crash(Exception):
    """The end of a run of the program."""


@pytest.fixture
def trip(tmp_path: Path) -> Iterator[Trip]:
    with rover() as (central, robot):
        yield Trip(central, robot, tmp_path / "trip.steps")


@contextmanager
def expect_crash() -> Iterator[None]:
    with pytest.raises(Crash):
        yield


def test_completed_step_is_skipped_and_keeps_its_value(trip: Trip) -> None:
    def look(number: int) -> tuple[int, str]:
        trip.robot.note(f"look {number}")
        return number, "seen"

    for _ in range(2):
        with expect_crash(), trip.mission() as mission:
            assert Status.of(mission.step("out", mission.Drive, x=1.0).status) is Status.COMPLETED
            assert mission.step("look", look, 3) == (3, "seen")
            raise Crash
    assert trip.robot.done == ["to 1", "stands at 1", "look 3"]


def test_completed_mission_starts_over(trip: Trip) -> None:
    for _ in range(2):
        with trip.mission() as mission:
            mission.step("out", mission.Drive, x=1.0)
    assert trip.robot.done == ["to 1", "stands at 1"] * 2
    assert not trip.file.exists()


def test_failed_step_is_repeated(trip: Trip) -> None:
    for fails in ("rock", ""):
        with expect_crash(), trip.mission() as mission:
            try:
                mission.step("out", mission.Drive, x=1.0, fails=fails)
            except MissionTaskFailed:
                assert fails
            raise Crash
    assert trip.robot.done == ["to 1", "stands at 1"] * 2


def crash_in_step(trip: Trip, **parameters: Any) -> None:
    """Run a program that dies in a step. Its checkpoint is restored to the moment of the death."""
    with expect_crash(), trip.mission() as mission:
        mission.step("before", mission.Drive, x=1.0)

        def drive() -> None:
            mission.Drive(**parameters)
            crash_in_step.file = trip.file.read_bytes()  # type: ignore[attr-defined]
            raise Crash

        mission.step("out", drive)
    trip.file.write_bytes(crash_in_step.file)  # type: ignore[attr-defined]
    trip.robot.done.clear()


def test_interrupted_step_is_uncertain(trip: Trip) -> None:
    crash_in_step(trip, x=2.0)
    with expect_crash(), trip.mission() as mission:
        mission.step("before", mission.Drive, x=1.0)
        with pytest.raises(
            StepUncertain, match=r"under way .* \(Drive \{\d+\} completed\): repeat it with"
        ) as caught:
            mission.step("out", list)
        assert [fate for _, fate in caught.value.outcomes] == ["completed"]
        mission.skip_step("out")
        assert mission.step("out", list) is None  # skipped
        raise Crash
    assert trip.robot.done == []


def test_interrupted_step_is_done_when_its_only_task_completed(trip: Trip) -> None:
    crash_in_step(trip, x=2.0)
    with trip.mission() as mission:
        assert Status.of(mission.step("out", mission.Drive, x=2.0).status) is Status.COMPLETED
    assert trip.robot.done == []


def test_interrupted_repeatable_step_is_repeated(trip: Trip) -> None:
    crash_in_step(trip, x=2.0)
    with trip.mission() as mission:
        assert mission.repeatable_step("out", list) == []


def test_step_of_another_epoch_is_uncertain(trip: Trip) -> None:
    crash_in_step(trip, x=2.0)
    trip.file.write_text(trip.file.read_text().replace('"epoch":"local"', '"epoch":"another"'))
    with trip.mission() as mission, pytest.raises(StepUncertain, match="is unknown to central"):
        mission.step("out", mission.Drive, x=2.0)


def test_step_names_must_be_unique_within_a_run(trip: Trip) -> None:
    with trip.mission() as mission:
        mission.step("round", list)
        with pytest.raises(
            MisuseError, match=r"step 'round' was done by this run .* f'round \{number\}'"
        ):
            mission.step("round", list)
        with pytest.raises(MisuseError, match="step 'outer' was begun by this run"):
            mission.step("outer", lambda: mission.step("outer", list))
        for no_name in (cast("str", 3), "\ud800"):
            with pytest.raises(MisuseError, match="name must be a text that can be sent"):
                mission.step(no_name, list)


def instant() -> datetime:
    return datetime(2026, 1, 2, 3, 4, 5)  # noqa: DTZ001 - without a zone its type would be lost


def pair() -> tuple[int, bytes]:
    return 1, b"\xff"


@pytest.mark.parametrize(
    "function",
    [
        instant,
        pair,
        lambda: nan,
        lambda: {1: [inf, None], "a": b"\0"},
        lambda: 2**63,
        lambda: datetime.now(UTC),
        lambda: TaskEnd(132, "x"),
    ],
)
def test_resumed_step_returns_the_stored_value(trip: Trip, function: Callable[[], Any]) -> None:
    values = []
    for again in (function, partial(pytest.fail, "it is done again")):
        again.__annotations__ = function.__annotations__
        with expect_crash(), trip.mission() as mission:
            values.append(mission.step("look", again))
            raise Crash
    assert repr(values[0]) == repr(values[1])
    assert type(values[0]) is type(function())


@pytest.mark.parametrize(
    "function",
    [lambda: "\ud800", lambda: 2**64, lambda: (1, 2), lambda: {1, 2}, lambda: date.max, object],
)
def test_step_value_that_cannot_be_stored_is_rejected(
    trip: Trip, function: Callable[[], Any]
) -> None:
    for _ in range(2):  # neither done nor uncertain
        with expect_crash(), trip.mission() as mission:
            with pytest.raises(
                MisuseError, match="step 'look' does not count as done: its value can't be stored"
            ):
                mission.step("look", function)
            raise Crash


def test_torn_checkpoint_line_is_dropped(trip: Trip) -> None:
    crash_in_step(trip, x=2.0)
    whole = trip.file.read_bytes()
    for torn in (b'{"step":"out","is":"do', b"\0\0\0\0\n", b'{"step":"out","is":"don\n'):
        trip.file.write_bytes(whole + torn)
        with expect_crash(), trip.mission() as mission:
            mission.step("before", mission.Drive, x=1.0)
            raise Crash
        assert trip.file.read_bytes() == whole
    assert trip.robot.done == []


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ('{"steps_of":"trip","version":2}\n?\n{"step":"a","is":"begun"}\n', "line 2 of .* is damaged"),
        ('{"steps_of":"other","version":2}\n', "holds the steps of mission 'other', not of 'trip'"),
        ('{"steps_of":"trip","version":9}\n', "in format 9"),
        ("precious\n", "holds no steps of a mission: give another file"),
        ('{"steps_of":"trip","version":2}\n{"step":"a","is":"task"}\n{"step":"a","is":"left"}\n', "line 2 of .* is damaged"),
    ],
)  # fmt: skip
def test_unusable_checkpoint_file_is_not_changed(trip: Trip, content: str, problem: str) -> None:
    trip.file.write_text(content)
    with pytest.raises(MisuseError, match=problem):
        trip.mission().open()
    assert trip.file.read_text() == content


def test_checkpoint_file_serves_one_mission_at_a_time(trip: Trip) -> None:
    with trip.mission(), pytest.raises(MisuseError, match="is in use by another running mission"):
        trip.mission().open()


def test_checkpoint_must_be_the_path_of_a_file(tmp_path: Path) -> None:
    with rover() as (central, _):
        for file, why in (
            (tmp_path, "Is a directory"),
            (tmp_path / "none" / "x.steps", "No such file or directory"),
        ):
            with pytest.raises(
                MisuseError,
                match=f"checkpoint {file} can't be opened: {why}: give the path of a file",
            ):
                Mission("rover", central=central, checkpoint=file).open()
    no_path: Any = 3
    with pytest.raises(MisuseError, match="checkpoint must be the path of a file, or None, not 3"):
        Mission("rover", checkpoint=no_path)

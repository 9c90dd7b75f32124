"""Ctrl-C while a task is being sent."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from missions.rover import rover

from tca_behaviours.missions import Mission
from tca_behaviours.missions.client import base_mission as client
from tca_behaviours.missions.client.interrupts import delay_interrupt


def test_ctrl_c_while_sending_stops_the_task(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    @contextmanager
    def pressed_meanwhile() -> Iterator[None]:
        with delay_interrupt():
            yield
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(client, "delay_interrupt", pressed_meanwhile)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with rover() as (central, robot), Mission("rover", central=central) as mission:
            with pytest.raises(KeyboardInterrupt):
                mission.Drive(x=5.0, fails="never")
            assert robot.done in ([], ["to 5", "stands at 5"])
            assert not mission.running_tasks()
    finally:
        signal.signal(signal.SIGINT, before)


def press_twice(reached: list[int]) -> None:
    with delay_interrupt():
        for number in (1, 2):
            signal.raise_signal(signal.SIGINT)
            reached.append(number)


def test_second_ctrl_c_is_not_delayed() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        reached: list[int] = []
        with pytest.raises(KeyboardInterrupt):
            press_twice(reached)
        assert reached == [1]
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)

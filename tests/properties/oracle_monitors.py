"""The rules of monitors."""

from typing import Any

from properties.oracle_records import Alarm, Job, Node, World


def born(world: World, node: Node, options: Any) -> None:
    """A new task is a monitor."""


def stop(world: World, node: Node) -> None:
    """A monitor watches no longer."""


def answered(world: World, job: Job, body: bytes | None, names: tuple[str, ...] = ("module lost",)) -> None:
    """A condition was answered."""


def rings(world: World, alarm: Alarm) -> None:
    """A monitor's time has come."""

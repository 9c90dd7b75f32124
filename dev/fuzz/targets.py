"""The targets, by name: each accepts any bytes, and raises an error only for a fault."""

from collections.abc import Callable
from random import Random
from typing import NamedTuple

from dev.fuzz import (
    hostile_central,
    hostile_files,
    hostile_image,
    hostile_inputs,
    hostile_peers,
    hostile_toml,
)


class Target(NamedTuple):
    """The attacked code."""

    attack: Callable[[bytes], None]
    seeds: Callable[[], list[bytes]]
    """A function that returns the first inputs."""
    most: int
    """The limit for the bytes of an input."""


def _random(longest: int, number: int = 20) -> Callable[[], list[bytes]]:
    """Return seeds of random bytes, for targets to which every input is meaningful."""
    return lambda: [
        (chance := Random(seed)).randbytes(chance.randrange(longest))  # noqa: S311
        for seed in range(number)
    ]


TARGETS = {
    "central": Target(hostile_central.attack, _random(400), 800),
    "packets": Target(hostile_central.attack_with_bytes, hostile_central.seeds_of_bytes, 8000),
    "image": Target(hostile_image.attack, _random(40), 60),
    "inputs": Target(hostile_inputs.attack, _random(400), 800),
    "session": Target(hostile_peers.attack_session, _random(600), 1200),
    "journal": Target(hostile_files.attack_journal, _random(400), 800),
    "journal-bytes": Target(
        hostile_files.attack_journal_with_bytes, hostile_files.seeds_of_journals, 4000
    ),
    "data": Target(hostile_files.attack_data, hostile_files.seeds_of_data, 400),
    "toml": Target(hostile_toml.attack, _random(300), 600),
    "formats": Target(hostile_files.attack_formats, _random(300), 600),
}

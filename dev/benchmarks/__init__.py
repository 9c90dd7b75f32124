"""The benchmarks for developers; those for users are in ``messages``."""

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dev.benchmarks.messages.processes import Children, address_in

BODY = bytes(100)


def rounds_of(measure: Callable[[float], dict[str, float]], about: str) -> list[dict[str, float]]:
    """Return the results of several rounds; the command line sets their number and duration."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    return [measure(options.seconds) for _ in range(options.rounds)]


def rate(seconds: float, do: Callable[[], int]) -> float:
    """Return how often per second *do* acts; it returns its count."""
    done, begin = 0, time.perf_counter()
    while (passed := time.perf_counter() - begin) < seconds:
        done += do()
    return done / passed


@contextmanager
def process(target: Callable[..., None], *arguments: Any) -> Iterator[None]:
    children = Children()
    children.serve(target, *arguments)
    try:
        yield
    finally:
        children.stop()


@contextmanager
def central(folder: Path, *options: str) -> Iterator[str]:
    children = Children()
    children.central(folder, *options)
    try:
        yield address_in(folder)
    finally:
        children.stop()

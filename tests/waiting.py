"""Waits for what other threads and processes do."""

import time
from collections.abc import Callable

SOON = 20.0  # seconds


def wait_until(is_true: Callable[[], object]) -> None:
    """Wait until a condition is true. Fails after SOON."""
    end = time.monotonic() + SOON
    while not is_true():
        assert time.monotonic() < end, "it did not become true"
        time.sleep(0.005)

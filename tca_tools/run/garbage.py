"""Python's search for garbage, which is out of place while a journal is taken in."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_garbage() -> Iterator[None]:
    """A fold only adds: Python would look through all of it for garbage, again and again, and take twice the time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()

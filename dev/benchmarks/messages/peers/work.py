"""The work of the task queues' workers: nothing, so that only the way there and back counts."""

import os
from pathlib import Path

WORKER = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])}
"""The environment of a worker, which finds ``move`` from any folder."""


def move(body: bytes, after: object = None) -> None:
    """Do nothing with *body*, after another job (*after*) is done."""
    del body, after

"""Saving a robot so that another process can take it over. A file is either the old snapshot or the new one."""

import os
import tempfile
from pathlib import Path

import msgspec

from robots.ambler_sim.vocabulary import Snapshot


def save_snapshot(state: Snapshot, path: str | Path) -> None:
    """Write the snapshot as JSON beside *path* and put it in place in one go."""
    path = Path(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(msgspec.json.encode(state))
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def load_snapshot(path: str | Path) -> Snapshot | None:
    """The snapshot saved at *path*, or None when there is none yet; raises msgspec.DecodeError for anything else."""
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        return None
    return msgspec.json.decode(data, type=Snapshot)

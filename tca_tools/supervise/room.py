"""Check whether the disk of a journal has room: central ends when the disk is full."""

import os
from pathlib import Path
from tempfile import TemporaryFile

ROOM = 1 << 20
"""Bytes: more than a central needs to start."""


def has_room(folder: Path) -> bool:
    """Whether a folder, which may not exist yet, has room for `ROOM` bytes.

    A file is written and removed, since quotas count, too.
    """
    place = next(one for one in (folder, *folder.resolve().parents) if one.is_dir())
    try:
        with TemporaryFile(dir=place) as probe:
            probe.write(bytes(ROOM))
            probe.flush()
            os.fsync(probe.fileno())
    except OSError:
        return False
    return True

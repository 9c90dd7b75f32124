"""Whether the disk of a journal has room again: central ends when it is full, and continues when it
is not.
"""

import os
from pathlib import Path
from tempfile import TemporaryFile

ROOM = 1 << 20
"""Bytes: more than a central needs to start."""


def has_room(folder: Path) -> bool:
    """Whether so much can be written in a folder, or where that is to be made. Quotas count, so it
    is tried.
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

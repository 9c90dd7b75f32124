"""Build wheels: of pure Python or, with TCA_COMPILED=1, with central's core and the busiest files
of the library compiled to machine code.

Compiling needs mypy (mypyc) and a C compiler. It is optional: the same core, about three times as
fast, and modules that use a fifth less processor time (decision 128).
"""

import os
from pathlib import Path

from setuptools import setup

PURE = {"__init__", "__main__", "events", "loading"}
"""Modules that stay Python: msgspec creates the classes of events itself."""

LIBRARY = [
    "tca_module/link/packet_line.py",
    "tca_module/link/turns.py",
    "tca_module/link/wait_loop.py",
    "tca_module/serving/slot.py",
    "tca_module/session/joined_replies.py",
    "tca_module/session/open_deliveries.py",
    "tca_module/session/open_requests.py",
    "tca_module/session/session.py",
    "tca_module/sockets/transport.py",
]
"""The files of the library that are compiled: a module spends most of its time in them."""


def core() -> list[str]:
    """Return the files of central that are compiled.

    Its shell and its replication stay Python, and so do the images of its state, which inspect all
    classes from outside.
    """
    files = sorted(Path("tca_central").rglob("*.py"))
    return [
        str(path)
        for path in files
        if path.stem not in PURE and path.parent.name not in ("shell", "image", "replication")
    ]


if os.environ.get("TCA_COMPILED"):
    from mypyc.build import mypycify

    groups = [
        mypycify(["--config-file=setup.cfg", *files], opt_level="3") for files in (core(), LIBRARY)
    ]
    setup(ext_modules=[extension for group in groups for extension in group])
else:
    setup()

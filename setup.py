"""Build wheels: of pure Python or, with TCA_COMPILED=1, with central's core compiled to machine
code.

Compiling needs mypy (mypyc) and a C compiler. It is optional: the same core, about three times as
fast.
"""

import os
from pathlib import Path

from setuptools import setup

PURE = {"__init__", "__main__", "events", "loading"}
"""Modules that stay Python: msgspec creates the classes of events itself."""


def core() -> list[str]:
    """Return the files of central that are compiled.

    Its shell stays Python, and so do the images of its state, which inspect all classes from
    outside.
    """
    files = sorted(Path("tca_central").rglob("*.py"))
    return [
        str(path)
        for path in files
        if path.stem not in PURE and path.parent.name not in ("shell", "image")
    ]


if os.environ.get("TCA_COMPILED"):
    from mypyc.build import mypycify

    setup(ext_modules=mypycify(["--config-file=setup.cfg", *core()], opt_level="3"))
else:
    setup()

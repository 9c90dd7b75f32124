"""Makes wheels: of pure Python or, with TCA_COMPILED=1, with central's core as machine code, too.

That takes mypy (mypyc) and a C compiler, and is never needed: the same core, about three times as
fast.
"""

import os
from pathlib import Path

from setuptools import setup

PURE = {"__init__", "__main__", "events", "loading"}
"""Modules that stay Python: msgspec makes the classes of events itself."""


def core() -> list[str]:
    """The files of central without its shell and the images of its state, which look at all classes
    from outside.
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

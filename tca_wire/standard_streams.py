"""Standard streams of a program that started without some of them: ``tca ... 2>&-``."""

import os
import sys
from pathlib import Path


def replace_closed_streams() -> None:
    """Connect closed standard streams to the null device.

    This also occupies their file numbers. Otherwise the next file or socket would get them, and a C
    library would write its complaints there.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
        if getattr(sys, name) is None:
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115

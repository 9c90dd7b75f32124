"""Standard streams of a program that was started without some of them: ``tca ... 2>&-``."""

import os
import sys
from pathlib import Path


def replace_closed_streams() -> None:
    """Let what is written to a closed stream go nowhere. Its number is taken too, or it would be
    that of the next file or socket, and a C library's complaint would go there.
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
            setattr(sys, name, Path(os.devnull).open("r" if name == "stdin" else "w"))  # noqa: SIM115

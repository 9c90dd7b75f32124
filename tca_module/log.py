"""The loggers of modules: "tca." and the module's name."""

import logging
import sys
import traceback
from collections.abc import Callable
from functools import partial


def log_of(name: str) -> logging.Logger:
    """The logger of a module. An error of a handler or filter that its user has added ends no
    thread of the module: it is printed, as logging does with errors of its own handlers.
    """
    logger = logging.getLogger(f"tca.{name}")
    if not isinstance(logger.handle, partial):
        logger.handle = partial(_handle, logger.handle)  # type: ignore[method-assign]
    return logger


def _handle(handle: Callable[[logging.LogRecord], None], record: logging.LogRecord) -> None:
    try:
        handle(record)
    except Exception:  # noqa: BLE001 - whatever it is, it is not about what was logged
        if logging.raiseExceptions and sys.stderr is not None:
            traceback.print_exc()

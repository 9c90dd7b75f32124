"""The loggers of modules. Each is called "tca." and the module's name."""

import logging
import sys
import traceback
from collections.abc import Callable
from functools import partial


def log_of(name: str) -> logging.Logger:
    """Return the logger of a module.

    If a log handler or filter of the user raises an error, the module's threads continue. The error
    is printed, as ``logging`` prints the errors of its own handlers.
    """
    logger = logging.getLogger(f"tca.{name}")
    if not isinstance(logger.handle, partial):
        logger.handle = partial(_handle, logger.handle)  # type: ignore[method-assign]
    return logger


def _handle(handle: Callable[[logging.LogRecord], None], record: logging.LogRecord) -> None:
    try:
        handle(record)
    except Exception:  # noqa: BLE001 - the error is unrelated to the logged event
        if logging.raiseExceptions and sys.stderr is not None:
            traceback.print_exc()

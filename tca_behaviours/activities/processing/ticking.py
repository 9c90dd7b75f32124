"""Ticks an activity. A tick that raises harms no other activity."""

from tca_behaviours.activities.processing.schedule import StateActivity
from tca_module.log import log_of

_LOG = log_of("activities")


def tick(activity: StateActivity) -> str:
    """Tick once. If the tick raises, log the traceback and return the error as text, else ""."""
    try:
        activity.tick()
    except BaseException as error:  # noqa: BLE001 - it would end the thread of all processors
        _LOG.exception("a tick of activity '%s' failed", activity.name)
        return f"{type(error).__name__}: {error}"
    return ""

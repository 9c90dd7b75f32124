"""Periodic tasks, missions written in Python, and state machines of tasks."""

from tca_missions.outcomes import (
    MISSION_TASK_FAILED,
    MISSION_TASK_INITIALISATION_FAILED,
    MISSION_TASK_TIMEOUT,
    Status,
    TaskEnd,
    TaskStatus,
    status_of,
)
from tca_missions.serving.definition import Idle, OnceTask, PeriodicTask
from tca_missions.serving.environment import Environment
from tca_missions.serving.parameters import parameter
from tca_missions.serving.server import TaskServer

__all__ = [
    "MISSION_TASK_FAILED", "MISSION_TASK_INITIALISATION_FAILED", "MISSION_TASK_TIMEOUT", "Environment", "Idle",
    "OnceTask", "PeriodicTask", "Status", "TaskEnd", "TaskServer", "TaskStatus", "parameter", "status_of",
]  # fmt: skip

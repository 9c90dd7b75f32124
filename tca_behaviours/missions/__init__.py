"""Periodic tasks, missions written in Python, and state machines of tasks."""

from tca_behaviours.missions.client.conditions import ConditionIsCompleted, ConditionVerified, MissionCondition
from tca_behaviours.missions.client.errors import (
    BadParameter,
    MissionTaskFailed,
    NotOffered,
    StepUncertain,
    UnknownTask,
)
from tca_behaviours.missions.client.mission import BaseMission, Mission
from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_behaviours.missions.outcomes import (
    MISSION_TASK_FAILED,
    MISSION_TASK_INITIALISATION_FAILED,
    MISSION_TASK_TIMEOUT,
    Status,
    TaskEnd,
    TaskStatus,
    status_of,
)
from tca_behaviours.missions.serving.definition import Idle, OnceTask, PeriodicTask
from tca_behaviours.missions.serving.environment import Environment
from tca_behaviours.missions.serving.parameters import parameter
from tca_behaviours.missions.serving.server import TaskServer
from tca_module import CentralLost, Rejected, TaskKilled, TcaError, Timeout

__all__ = [
    "MISSION_TASK_FAILED",
    "MISSION_TASK_INITIALISATION_FAILED",
    "MISSION_TASK_TIMEOUT",
    "BadParameter",
    "BaseMission",
    "CentralLost",
    "ConditionIsCompleted",
    "ConditionVerified",
    "Environment",
    "Idle",
    "Mission",
    "MissionCondition",
    "MissionTaskFailed",
    "NotOffered",
    "OnceTask",
    "PeriodicTask",
    "Rejected",
    "Status",
    "StepUncertain",
    "TaskEnd",
    "TaskHandle",
    "TaskKilled",
    "TaskServer",
    "TaskStatus",
    "TcaError",
    "Timeout",
    "UnknownTask",
    "parameter",
    "status_of",
]

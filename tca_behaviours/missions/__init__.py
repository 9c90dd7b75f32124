"""Periodic tasks, missions written in Python, and state machines of tasks."""

from tca_behaviours.missions.client.base_mission import BaseMission as BaseMission
from tca_behaviours.missions.client.conditions import ConditionIsCompleted as ConditionIsCompleted
from tca_behaviours.missions.client.conditions import ConditionIsRunning as ConditionIsRunning
from tca_behaviours.missions.client.conditions import ConditionVerified as ConditionVerified
from tca_behaviours.missions.client.conditions import MissionCondition as MissionCondition
from tca_behaviours.missions.client.conditions import NegatedCondition as NegatedCondition
from tca_behaviours.missions.client.conditions import VariableCondition as VariableCondition
from tca_behaviours.missions.client.errors import BadParameter as BadParameter
from tca_behaviours.missions.client.errors import MissionTaskFailed as MissionTaskFailed
from tca_behaviours.missions.client.errors import NotOffered as NotOffered
from tca_behaviours.missions.client.errors import StepUncertain as StepUncertain
from tca_behaviours.missions.client.errors import UnknownTask as UnknownTask
from tca_behaviours.missions.client.mission import Mission as Mission
from tca_behaviours.missions.client.running_task import RunningTask as RunningTask
from tca_behaviours.missions.client.task_handle import TaskHandle as TaskHandle
from tca_behaviours.missions.outcomes import MISSION_TASK_FAILED as MISSION_TASK_FAILED
from tca_behaviours.missions.outcomes import (
    MISSION_TASK_INITIALISATION_FAILED as MISSION_TASK_INITIALISATION_FAILED,
)
from tca_behaviours.missions.outcomes import MISSION_TASK_TIMEOUT as MISSION_TASK_TIMEOUT
from tca_behaviours.missions.outcomes import Status as Status
from tca_behaviours.missions.outcomes import TaskEnd as TaskEnd
from tca_behaviours.missions.outcomes import TaskStatus as TaskStatus
from tca_behaviours.missions.outcomes import status_of as status_of
from tca_behaviours.missions.serving.definition import Idle as Idle
from tca_behaviours.missions.serving.definition import OnceTask as OnceTask
from tca_behaviours.missions.serving.definition import PeriodicTask as PeriodicTask
from tca_behaviours.missions.serving.environment import Environment as Environment
from tca_behaviours.missions.serving.parameters import parameter as parameter
from tca_behaviours.missions.serving.server import TaskServer as TaskServer
from tca_module import CentralLost as CentralLost
from tca_module import Rejected as Rejected
from tca_module import TaskKilled as TaskKilled
from tca_module import TcaError as TcaError
from tca_module import Timeout as Timeout

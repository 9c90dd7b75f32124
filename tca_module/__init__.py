"""The library that a robot module imports: declare messages, handle them, send them."""

from tca_module.client import Client, connect
from tca_module.errors import (
    BadData,
    CentralLost,
    Deadlock,
    FormatRefused,
    LockLost,
    MisuseError,
    NotDeclared,
    QueryFailed,
    Refused,
    Stopped,
    TaskFailed,
    TaskKilled,
    TcaError,
    Timeout,
    VariableNotSet,
)
from tca_module.module import Module
from tca_module.sending.claim import Claim
from tca_module.sending.constraints import this
from tca_module.sending.context import Heard, MonitorHandle, Trouble
from tca_module.sending.control import MonitorOptions
from tca_module.sending.directory import HandlerInfo, ModuleInfo, ResourceInfo
from tca_module.sending.options import TaskOptions
from tca_module.sending.replies import Notification, PendingReplies, PendingReply
from tca_module.sending.sender import Sender
from tca_module.sending.task import Task
from tca_module.sending.task_handle import Attached, TaskHandle, TaskInfo
from tca_module.sending.task_ref import TaskRef
from tca_module.serving.callbacks import Callback
from tca_module.serving.later import Later
from tca_wire.constraints import Constraint
from tca_wire.errors import BadFormat
from tca_wire.messages.controls import DemonMonitor, ExceptionHandler, PointMonitor, PollingMonitor
from tca_wire.messages.declarations import (
    Broadcast,
    Command,
    Failure,
    FailureRaised,
    Goal,
    Inform,
    Message,
    MultiQuery,
    Query,
    Variable,
)
from tca_wire.messages.notices import HANDLERS_CHANGED, MODULE_JOINED, MODULE_LEFT, Arrival, Departure, HandlerCount
from tca_wire.points import Edge, Interval, Moment, Point
from tca_wire.vocabulary import Condition, Outcome, Scope

__all__ = [
    "HANDLERS_CHANGED",
    "MODULE_JOINED",
    "MODULE_LEFT",
    "Arrival",
    "Attached",
    "BadData",
    "BadFormat",
    "Broadcast",
    "Callback",
    "CentralLost",
    "Claim",
    "Client",
    "Command",
    "Condition",
    "Constraint",
    "Deadlock",
    "DemonMonitor",
    "Departure",
    "Edge",
    "ExceptionHandler",
    "Failure",
    "FailureRaised",
    "FormatRefused",
    "Goal",
    "HandlerCount",
    "HandlerInfo",
    "Heard",
    "Inform",
    "Interval",
    "Later",
    "LockLost",
    "Message",
    "MisuseError",
    "Module",
    "ModuleInfo",
    "Moment",
    "MonitorHandle",
    "MonitorOptions",
    "MultiQuery",
    "NotDeclared",
    "Notification",
    "Outcome",
    "PendingReplies",
    "PendingReply",
    "Point",
    "PointMonitor",
    "PollingMonitor",
    "Query",
    "QueryFailed",
    "Refused",
    "ResourceInfo",
    "Scope",
    "Sender",
    "Stopped",
    "Task",
    "TaskFailed",
    "TaskHandle",
    "TaskInfo",
    "TaskKilled",
    "TaskOptions",
    "TaskRef",
    "TcaError",
    "Timeout",
    "Trouble",
    "Variable",
    "VariableNotSet",
    "connect",
    "this",
]

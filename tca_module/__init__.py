"""The library that a robot's programs import: declare messages, handle them, send them.

Example::

    from tca_module import Command, Module, Task, connect

    MOVE = Command("move", float, result=float)
    arm = Module("arm")

    @arm.handles(MOVE)
    def move(task: Task, angle: float) -> float:
        return angle

    with arm.running(), connect("operator") as user:
        print(user.command(MOVE, 0.5).result(timeout=5))
"""

from tca_module.asynchronous.async_client import AsyncClient, aconnect
from tca_module.asynchronous.async_sender import AsyncClaim, AsyncSender
from tca_module.asynchronous.async_tasks import AsyncSentTask, AsyncStream, AsyncTaskRef
from tca_module.asynchronous.loop_handlers import AsyncTask
from tca_module.client import CentralAddress, Client, OnLeave, connect
from tca_module.errors import (
    BadData,
    CentralLost,
    Deadlock,
    FormatRefused,
    LockLost,
    MisuseError,
    NotDeclared,
    NotSent,
    QueryFailed,
    Refused,
    Rejected,
    Stopped,
    TaskFailed,
    TaskKilled,
    TcaError,
    Timeout,
    VariableNotSet,
)
from tca_module.following.mirror import ChangeCallback
from tca_module.following.stream import Stream
from tca_module.following.update import PendingUpdate
from tca_module.module import Module
from tca_module.sending.any_task import wait_for_any
from tca_module.sending.attachments import AttachmentRef, Recovery
from tca_module.sending.central_services import Topic
from tca_module.sending.claim import Claim
from tca_module.sending.delivery_context import MonitorRef, TapEvent, Trouble
from tca_module.sending.directory import HandlerInfo, MessageInfo, ModuleInfo, ResourceInfo
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.replies import Notification, PendingReplies, PendingReply
from tca_module.sending.sender import Sender, TaskOptions
from tca_module.sending.steerable_task import TaskInfo
from tca_module.sending.task import Task
from tca_module.sending.task_points import TaskInterval, this
from tca_module.sending.task_ref import Change, SentTask, TaskRef
from tca_module.sending.task_requests import Requests, TaskRequest
from tca_module.sending.watching import MonitorOptions, Watched
from tca_module.serving.callbacks import Callback, HasFileno
from tca_module.serving.handler_options import HandlerOptions, WhenBusy
from tca_module.serving.module_callbacks import CallbackFunction
from tca_module.serving.server import Server
from tca_wire.constraints import Constraint
from tca_wire.errors import BadFormat
from tca_wire.life_cycles import (
    BASIC,
    GENERAL,
    ONE_UPDATE,
    ROS_GOAL,
    Effect,
    LifeCycle,
    Transition,
    ending,
)
from tca_wire.messages.built_in import (
    BAD_DATA,
    CANCELLED,
    DEADLOCK,
    FORGOTTEN,
    HANDLER_ERROR,
    LOCK_LOST,
    MODULE_LOST,
    OVERLOAD,
    REJECTED,
    TIMEOUT,
    UNCERTAIN,
)
from tca_wire.messages.controls import (
    Action,
    DemonMonitor,
    ExceptionHandler,
    Monitor,
    PointMonitor,
    PollingMonitor,
)
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
    Retry,
    TaskMessage,
    Variable,
)
from tca_wire.messages.notices import (
    HANDLERS_CHANGED,
    MODULE_JOINED,
    MODULE_LEFT,
    Arrival,
    Departure,
    HandlerCount,
)
from tca_wire.points import Edge, Interval, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Outcome, Party, Refusal, Scope

__all__ = [
    "BAD_DATA",
    "BASIC",
    "CANCELLED",
    "DEADLOCK",
    "FORGOTTEN",
    "GENERAL",
    "HANDLERS_CHANGED",
    "HANDLER_ERROR",
    "LOCK_LOST",
    "MODULE_JOINED",
    "MODULE_LEFT",
    "MODULE_LOST",
    "ONE_UPDATE",
    "OVERLOAD",
    "REJECTED",
    "ROS_GOAL",
    "TIMEOUT",
    "UNCERTAIN",
    "Action",
    "Arrival",
    "AsyncClaim",
    "AsyncClient",
    "AsyncSender",
    "AsyncSentTask",
    "AsyncStream",
    "AsyncTask",
    "AsyncTaskRef",
    "AttachmentRef",
    "BadData",
    "BadFormat",
    "Broadcast",
    "Callback",
    "CallbackFunction",
    "CentralAddress",
    "CentralLost",
    "Change",
    "ChangeCallback",
    "Claim",
    "Client",
    "Command",
    "Condition",
    "Constraint",
    "Deadlock",
    "DemonMonitor",
    "Departure",
    "Edge",
    "Effect",
    "ExceptionHandler",
    "Failure",
    "FailureRaised",
    "FormatRefused",
    "Goal",
    "HandlerCount",
    "HandlerInfo",
    "HandlerOptions",
    "HasFileno",
    "Inform",
    "Interval",
    "LaterReply",
    "LifeCycle",
    "LockLost",
    "Message",
    "MessageClass",
    "MessageInfo",
    "MisuseError",
    "Module",
    "ModuleInfo",
    "Moment",
    "Monitor",
    "MonitorOptions",
    "MonitorRef",
    "MultiQuery",
    "NotDeclared",
    "NotSent",
    "Notification",
    "OnLeave",
    "Outcome",
    "Party",
    "PendingReplies",
    "PendingReply",
    "PendingUpdate",
    "Point",
    "PointMonitor",
    "PollingMonitor",
    "Query",
    "QueryFailed",
    "Recovery",
    "Refusal",
    "Refused",
    "Rejected",
    "Requests",
    "ResourceInfo",
    "Retry",
    "Scope",
    "Sender",
    "SentTask",
    "Server",
    "Stopped",
    "Stream",
    "TapEvent",
    "Task",
    "TaskFailed",
    "TaskId",
    "TaskInfo",
    "TaskInterval",
    "TaskKilled",
    "TaskMessage",
    "TaskOptions",
    "TaskRef",
    "TaskRequest",
    "TcaError",
    "Timeout",
    "Topic",
    "Transition",
    "Trouble",
    "Variable",
    "VariableNotSet",
    "Watched",
    "WhenBusy",
    "aconnect",
    "connect",
    "ending",
    "this",
    "wait_for_any",
]

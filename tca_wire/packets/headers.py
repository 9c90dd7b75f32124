"""The headers that modules and central exchange: what a module says is in to_central.py, what central says in
to_module.py, and what is about direct messages in routes.py. docs/protocol.md has the bytes.

A header travels with a body of opaque bytes (user data as MessagePack; central never looks inside). Types named in the
imperative are sent by a module, the others by central.
"""

from tca_wire.packets.to_central import (
    Ask,
    Attach,
    Await,
    AwaitAny,
    Bye,
    Constrain,
    Deadline,
    EndMonitor,
    Fail,
    Fire,
    GetVariable,
    GiveUp,
    Hello,
    Inspect,
    Keep,
    Kill,
    Lock,
    Raise,
    Register,
    Release,
    Remove,
    Reply,
    Retry,
    Send,
    SetVariable,
    Suspend,
    Tap,
    ToCentral,
    Unlock,
    Unregister,
    WaitFor,
    WaitUntilHandled,
)  # fmt: skip
from tca_wire.packets.to_module import (
    Accepted,
    Answer,
    Beat,
    Cancelled,
    Closing,
    Deliver,
    Refused,
    Suspended,
    Taken,
    ToModule,
    Unknown,
    Welcome,
)  # fmt: skip

PROTOCOL_VERSION = 3
"""Goes up whenever a header changes: who speaks another one is refused, and told so."""

__all__ = [
    "PROTOCOL_VERSION", "Accepted", "Answer", "Ask", "Attach", "Await", "AwaitAny", "Beat", "Bye", "Cancelled",
    "Closing", "Constrain", "Deadline", "Deliver", "EndMonitor", "Fail", "Fire", "GetVariable", "GiveUp", "Hello",
    "Inspect", "Keep", "Kill", "Lock", "Raise", "Refused", "Register", "Release", "Remove", "Reply", "Retry",
    "Send", "SetVariable", "Suspend", "Suspended", "Taken", "Tap", "ToCentral", "ToModule", "Unknown", "Unlock",
    "Unregister", "WaitFor", "WaitUntilHandled", "Welcome",
]  # fmt: skip

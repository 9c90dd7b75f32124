"""Explains what is wrong with the servers of a log, and checks their settings."""

import json
import socket
from collections.abc import Sequence
from urllib.parse import urlsplit

from nats.errors import AuthorizationError
from nats.js.api import RetentionPolicy, StorageType, StreamConfig, StreamInfo
from nats.js.errors import APIError

from tca_central.errors import CentralError
from tca_central.replication.shared_log import PIECE_BYTES

LEAST_PAYLOAD = PIECE_BYTES + (4 << 10)
"""Bytes of a message with its headers, which a server must accept."""
_PROBE_WITHIN = 1.0
_NO_ROOM = {10023, 10047, 10077}
"""Errors of JetStream for a full disk, and for full limits of a server and a stream."""
_UNSEEN = 3_000_000_000
"""Nanoseconds without a heartbeat after which a server does not count. There is one a second."""


def has_quorum(info: StreamInfo) -> bool:
    """Whether more than half of a stream's servers run: the leader answers a while without them."""
    others = (info.cluster and info.cluster.replicas) or []
    running = sum(not one.offline and (one.active or 0) < _UNSEEN for one in others)
    return bool(2 * (1 + running) > 1 + len(others))


def is_full(error: Exception) -> bool:
    """Whether the servers have no room for a message."""
    return isinstance(error, APIError) and error.err_code in _NO_ROOM


def is_refusal(error: Exception) -> bool:
    """Whether a server refuses the user."""
    return isinstance(error, AuthorizationError) or "authorization violation" in str(error).lower()


def explanation(servers: Sequence[str], error: Exception) -> str:
    """Return why a log does not answer, and what to do. It connects to each server."""
    if is_full(error):
        return "has no room: free the disks of its servers, or raise their max_file_store"
    if is_refusal(error):
        return "refuses the user: write nats://user:password@host or nats://token@host"
    wrong = [f"{_place(one)} {why}" for one in servers if (why := _probe(one))]
    said = getattr(error, "description", None) or str(error) or type(error).__name__
    why = ", ".join(wrong) or said
    return (
        f"does not answer ({why}): more than half of its servers must run, and have room on "
        "their disks"
    )


def _place(server: str) -> str:
    return server.rpartition("/")[2].rpartition("@")[2]


def _probe(server: str) -> str:
    """Return why a server can't be used; "" if nothing is wrong."""
    try:
        url = urlsplit(server)
        place = url.hostname or "", url.port or 4222
        with socket.create_connection(place, _PROBE_WITHIN) as line:
            line.settimeout(_PROBE_WITHIN)
            told = line.makefile("rb").readline(1 << 16)
    except TimeoutError:
        return "is silent or not a NATS server"
    except (OSError, ValueError) as error:
        return f"can't be reached: {getattr(error, 'strerror', None) or error}"
    try:
        return "" if json.loads(told.removeprefix(b"INFO ")).get("jetstream") else _NO_JETSTREAM
    except ValueError:
        return "is not a NATS server"


_NO_JETSTREAM = "has no JetStream: add 'jetstream {}' to its configuration"


def check_payload(server: str, payload: int) -> None:
    """Raise CentralError if a server accepts only messages that are too short."""
    if payload < LEAST_PAYLOAD:
        msg = (
            f"the server {_place(server)} accepts messages of at most {payload:,} bytes, and the "
            f"log needs {LEAST_PAYLOAD:,}: set its max_payload to 1MB"
        )
        raise CentralError(msg)


def check_stream(config: StreamConfig, subject: str, servers: int) -> str:
    """Check whether a stream is a log that loses no message. Return a warning; "" without one.

    Raises CentralError.
    """
    name = config.name
    if config.subjects != [subject] or config.mirror or config.sources:
        msg = (
            f"the stream {name} is not a log of central, because its subjects are not '{subject}': "
            "choose another NAME in nats://.../NAME, or delete the stream"
        )
        raise CentralError(msg)
    limits = {
        "storage": config.storage == StorageType.FILE,
        "retention": config.retention == RetentionPolicy.LIMITS,
        "max_age": not config.max_age,
        "max_bytes": (config.max_bytes or -1) < 0,
        "max_msgs": (config.max_msgs or -1) < 0,
        "max_msgs_per_subject": (config.max_msgs_per_subject or -1) < 0,
        "max_msg_size": (config.max_msg_size or -1) < 0 or config.max_msg_size >= LEAST_PAYLOAD,
        "no_ack": not config.no_ack,
        "sealed": not config.sealed,
        "deny_purge": not config.deny_purge,
    }
    if wrong := [key for key, is_right in limits.items() if not is_right]:
        msg = (
            f"the stream {name} would lose messages, because of its {' and '.join(wrong)}: "
            "delete the stream, and central creates it anew"
        )
        raise CentralError(msg)
    copies = config.num_replicas or 1
    if copies >= min(servers, 5):
        return ""
    return (
        f"the stream {name} has {copies} of {servers} copies: "
        f"run 'nats stream edit {name} --replicas {min(servers, 5)}'"
    )

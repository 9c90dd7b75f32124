"""The records of a replicated log, which readers put together from its messages."""

from typing import NamedTuple

import msgspec

from tca_central.errors import CentralError
from tca_central.events import Input
from tca_central.replication.shared_log import Kind, Message
from tca_central.shell.input_log import INPUT_VERSION, Ended
from tca_wire.packets.headers import PROTOCOL_VERSION


class Term(msgspec.Struct, frozen=True, array_like=True, tag="term"):
    """A central leads from here on."""

    version: int
    protocol: int
    central: str  #: the version of central
    epoch: str
    is_first: bool  #: whether a new run starts here, from an empty state
    member: str  #: the process that leads, as "host:pid"
    address: str  #: where modules find it
    key: str  #: the public key with which it listens; "" without keys


class Turn(NamedTuple):
    """The inputs of one turn."""

    sequence: int  #: the number of the record's last message
    inputs: list[Input | Ended]


class Image(msgspec.Struct, frozen=True, array_like=True, tag="image"):
    """The state of a run after all turns up to a message."""

    after: int
    epoch: str
    data: bytes


Record = Term | Turn | Image

encode = msgspec.msgpack.Encoder().encode
_decode_term = msgspec.msgpack.Decoder(Term).decode
_decode_image = msgspec.msgpack.Decoder(Image).decode
_decode_turn = msgspec.msgpack.Decoder(list[Input | Ended]).decode


class Pieces:
    """Puts records together."""

    def __init__(self) -> None:
        self._pieces: dict[Kind, list[bytes]] = {}  #: an image's pieces lie between turns

    def add(self, message: Message) -> Record | None:
        """Return the record that a message completes; None if it completes none.

        Raises CentralError if another version wrote it.
        """
        if message.kind is Kind.TERM:  # the leader before may have died within a record
            self._pieces.clear()
        pieces = self._pieces.setdefault(message.kind, [])
        if not message.part:
            pieces.clear()
        if message.part != len(pieces):  # the first pieces were removed
            return None
        pieces.append(message.data)
        if message.is_more:
            return None
        data = pieces[0] if len(pieces) == 1 else b"".join(pieces)
        pieces.clear()
        try:
            if message.kind is Kind.TERM:
                return _checked(_decode_term(data))
            if message.kind is Kind.IMAGE:
                return _decode_image(data)
            return Turn(message.sequence, _decode_turn(data))
        except msgspec.MsgspecError as error:
            msg = f"message {message.sequence} of the log can't be read: {error}"
            raise CentralError(msg) from None


def ends_run(message: Message) -> bool:
    """Whether a message ends a run."""
    if message.kind is not Kind.TURN:
        return False
    try:
        return isinstance(_decode_turn(message.data)[-1], Ended)
    except msgspec.MsgspecError:  # a later piece of a turn
        return False


def _checked(term: Term) -> Term:
    if (term.version, term.protocol) != (INPUT_VERSION, PROTOCOL_VERSION):
        msg = (
            f"tca {term.central} wrote the log, of format {term.version}.{term.protocol}, and this "
            f"tca reads only {INPUT_VERSION}.{PROTOCOL_VERSION}: run tca {term.central} everywhere"
        )
        raise CentralError(msg)
    return term

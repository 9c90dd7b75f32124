"""Common parts of all declarations: names, formats, and the base class of messages."""

import inspect
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from tca_wire.errors import BadData, BadFormat
from tca_wire.messages.formats import Format
from tca_wire.messages.large_data import LargeData, why_unreadable
from tca_wire.packets.large import Keep
from tca_wire.packets.parts import MessageFormat
from tca_wire.vocabulary import Limit, MessageClass, is_name

D = TypeVar("D")
R = TypeVar("R")


class Declaring(type):
    """The metaclass of declarations: errors for wrong arguments name the declared class."""

    @property
    def __signature__(cls) -> inspect.Signature:
        """The arguments of the class itself, for ``help``."""
        signature = inspect.signature(cls.__init__)  # type: ignore[misc]  # of the class itself
        return signature.replace(parameters=list(signature.parameters.values())[1:])

    # Hidden from type checkers: they would infer Any for every declaration, instead of reading
    # __init__.
    if not TYPE_CHECKING:

        def __call__(cls, *arguments: Any, **options: Any) -> Any:
            """Create a declaration. Raises TypeError."""
            signature = cls.__signature__
            try:
                # Report a wrong name before a missing one.
                signature.bind_partial(*arguments, **options)
                signature.bind(*arguments, **options)
            except TypeError as error:
                problem = str(error).replace(" keyword-only", "")
                raise TypeError(
                    f"{cls.__name__}(): {problem}: write {cls.__name__}{_without_types(signature)}"
                ) from None
            return super().__call__(*arguments, **options)


def _without_types(signature: inspect.Signature) -> inspect.Signature:
    empty = inspect.Parameter.empty
    return inspect.Signature(
        [one.replace(annotation=empty) for one in signature.parameters.values()]
    )


def checked_name(name: str) -> str:
    """Return a message's or failure's name. Raises BadFormat if it cannot be one."""
    if not isinstance(name, str) or not is_name(name):
        msg = f"{name!r:.40} is not a message name: give 1 to {Limit.NAME:d} printable characters"
        raise BadFormat(msg)
    return name


def format_of(kind: Any, subject: str) -> Format[Any]:
    """Return the format of a type (None: no data); a format is returned as it is."""
    try:
        if isinstance(kind, Format):
            return kind
        return Format(type(None) if kind is None else kind)
    except BadFormat as error:
        why = f": {error}"
        if isinstance(kind, str | int | float) or isinstance(type(kind), Declaring):
            why = f" must be a type, such as float or list[str], not {kind!r:.60}"
        raise BadFormat(subject + why) from None


class Message(Generic[D, R], metaclass=Declaring):
    """A declared message: data of type D, reply or result of type R. Use one of the subclasses."""

    message_class: ClassVar[MessageClass]

    def __init__(
        self, name: str, data: Any = None, reply: Any = None, *, journal: bool = False
    ) -> None:
        self.name = checked_name(name)
        self.title = f"{self.message_class} '{name}'"  #: for errors
        self.data: Format[D] = format_of(data, f"the data of {self.title}")
        reply_of = f"the {'result' if self.message_class.is_task else 'reply'} of {self.title}"
        self.reply: Format[R] = format_of(reply, reply_of)
        if not isinstance(journal, bool):
            raise BadFormat(f"journal= of {self.title} must be True or False, not {journal!r:.60}")
        self.journal = journal

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, {self.data} -> {self.reply})"

    @property
    def format(self) -> MessageFormat:
        """The message's format, as registered with central."""
        return MessageFormat(self.name, self.message_class, self.data.schema, self.reply.schema)

    @property
    def needs(self) -> "Sequence[Message[Any, Any]]":
        """The messages that must be declared before this one."""
        return ()

    def encode_data(self, data: D) -> bytes:
        """Encode *data*. Raises BadData, naming message and field."""
        if data is not None and self.data.kind is type(None):
            msg = f"{self.title} is declared without data, but got {data!r:.60}"
            raise BadData(msg)
        try:
            is_kept = self.message_class.is_task or self.message_class.keeps_value
            why = Keep.TASK if is_kept else Keep.NOTHING
            return self.kept(self.data.encode(data), why)
        except BadData as error:
            msg = f"{self.title} wants data of type {self.data}: {error}"
            raise BadData(msg) from None

    def decode_data(self, data: bytes) -> D:
        """Decode the data of a received message. Raises BadData, naming message and field."""
        try:
            return self.data.decode(data)
        except BadData as error:
            msg = f"{self.title} came with data that is not of type {self.data}: {error}"
            if why := why_unreadable(data):
                msg = f"{self.title}: {why}"
            raise BadData(msg) from None

    def encode_reply(self, reply: R) -> bytes:
        """Encode a handler's return value. Raises BadData, naming message and field."""
        try:
            return self.kept(self.reply.encode(reply))
        except BadData as error:
            msg = f"the handler of {self.title} must return {self.reply}: {error}"
            raise BadData(msg) from None

    def decode_reply(self, reply: bytes) -> R:
        """Decode the reply or result of a message. Raises BadData, naming message and field."""
        try:
            return self.reply.decode(reply)
        except BadData as error:
            msg = f"the answer to {self.title} is not of type {self.reply}: {error}"
            if why := why_unreadable(reply):
                msg = f"the answer to {self.title}: {why}"
            raise BadData(msg) from None

    def kept(self, body: bytes, why: Keep = Keep.NOTHING) -> bytes:
        """Note in a body with large data why these are also written to the disk. Return it."""
        if isinstance(body, LargeData):
            body.keep = why | Keep.JOURNAL if self.journal else why
        return body


def with_needed(messages: Iterable[Message[Any, Any]]) -> Iterator[Message[Any, Any]]:
    """Yield messages, each after those that must be declared before it."""
    for message in messages:
        yield from with_needed(message.needs)
        yield message

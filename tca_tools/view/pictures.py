"""Pictures that modules publish as shared variables with a name such as "picture of the arm".

The value is SVG as text, or PNG as bytes.
"""

from base64 import b64encode
from contextlib import suppress

import msgspec

from tca_tools.journal.records import Message

PICTURE_OF = "picture of "
"""The start of the names."""

_PNG = b"\x89PNG\r\n\x1a\n"


def is_picture(message: Message) -> bool:
    """Whether a message set a variable whose name announces a picture."""
    return message.message_class.keeps_value and message.name.startswith(PICTURE_OF)


def picture_in(message: Message) -> dict[str, str]:
    """Return the picture in a message as a data URL, or why it can't be shown."""
    with suppress(msgspec.MsgspecError):
        match msgspec.msgpack.decode(message.body):
            case str() as text if "<svg" in text:
                return _image("svg+xml", text.encode())
            case bytes() as data if data.startswith(_PNG):
                return _image("png", data)
    return {"problem": "this value is neither SVG as text nor PNG as bytes"}


def _image(kind: str, data: bytes) -> dict[str, str]:
    return {"image": f"data:image/{kind};base64,{b64encode(data).decode()}"}

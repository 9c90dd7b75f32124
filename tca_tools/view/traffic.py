"""Senders, messages and handlers of a run: columns that a page counts for any time. Pure."""

from tca_tools.journal.records import Handling, Message
from tca_tools.journal.whole_run import Run
from tca_tools.view.columns import Columns

TRAFFIC_TABLES = {
    # kind: the message's class; handler: "" until a handler has started
    "link": "sender:t message:t kind:t handler:t",
    "sent": "link:i time:d less:B",  # less: the count decreases, since a handler has started
}


class Traffic:
    """Fills the columns of links and sent messages.

    A link is a sender, a message and the handling module. Each run of a handler adds one row.
    """

    def __init__(self, run: Run, columns: Columns) -> None:
        self._run, self._columns = run, columns
        self._links: dict[tuple[str, str, str, str], int] = {}
        self._unhandled: dict[int, int] = {}
        """The links of messages whose handler has not started."""

    def add_message(self, message: Message) -> None:
        """Count a sent message. If it has several handlers, it counts when each of them starts."""
        kind = message.message_class
        if not (kind.is_monitor or kind.fans_out or message.handlings):
            link = self._unhandled[message.id] = self._link(message.sender, message.name, kind, "")
            self._columns.add("sent", link, self._run.time, False)

    def add_handling(self, handling: Handling) -> None:
        """Count a message whose handler has started."""
        if (link := self._unhandled.pop(handling.message_id, None)) is not None:
            self._columns.add("sent", link, self._run.time, True)
        if (message := self._run.messages.get(handling.message_id)) is not None:
            kind = message.message_class
            link = self._link(message.sender, message.name, kind, handling.module)
            self._columns.add("sent", link, handling.start, False)

    def _link(self, sender: str, message: str, kind: str, handler: str) -> int:
        key = sender, message, kind, handler
        if key not in self._links:
            self._links[key] = self._columns.add("link", *key)
        return self._links[key]

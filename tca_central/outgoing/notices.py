"""What central itself broadcasts about who is there. Nothing is sent, or recorded, that nobody listens to."""

from tca_central.outgoing.central_messages import make_statement
from tca_central.state import State
from tca_wire.messages.declarations import D
from tca_wire.messages.notices import Notice
from tca_wire.vocabulary import Role


def broadcast_notice(central: State, notice: Notice[D], data: D) -> None:
    """Send a notice to all who handle it."""
    message = central.registry.messages.get(notice.name)
    if message is None or not message.serving:
        return
    make_statement(central, message, notice.encode_data(data), Role.NONE, about=None)

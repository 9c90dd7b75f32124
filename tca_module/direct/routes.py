"""The routes on which a connection may send directly, as central assigns them, and their paths.

A message goes through central until an entrance of its route has answered a greeting. It also goes
through central whenever no entrance can be reached. A path is retained while a route leads to its
entrance, a query is open, or an inform may not have begun.
"""

import itertools
import time
from collections import deque
from secrets import token_hex

from tca_module.direct.note_batch import NoteBatch
from tca_module.direct.path import DirectPath
from tca_module.log import log_of
from tca_module.session.request import Request
from tca_module.session.session import Session
from tca_module.sockets.direct import PathSocket
from tca_module.sockets.transport import DealerTransport
from tca_wire.packets.headers import Send, ToCentral, Welcome
from tca_wire.packets.routes import Barred, Entrance, Route, WatchEntrance


class DirectRoutes:
    """The sending side of direct messages, for one connection."""

    def __init__(
        self, session: Session, transport: DealerTransport | None, notes: NoteBatch
    ) -> None:
        self._session = session
        self._id = token_hex(16)  #: identifies this connection
        self._transport = transport
        self._notes = notes
        self._routes: dict[str, deque[DirectPath]] = {}  #: message -> its paths, used in turn
        self.paths: dict[str, DirectPath] = {}  #: endpoint -> path
        self._numbers = itertools.count(1)
        self.lost = 0  #: number of informs that may never have reached their handler
        self._has_logged_drops = False  #: whether the log says that informs are dropped
        self._is_tidy = True  #: whether no path can be closed
        self._epoch = ""
        self._log = log_of(session.module)

    def send_query(self, header: Send, body: bytes) -> Request | None:
        """Send a query directly, and return its request; None if it must go through central."""
        if not self.paths or header.if_handled or (path := self._path_for(header.message)) is None:
            return None
        request = Request(header, body, wants_answer=True)
        return request if path.send_query(request, time.monotonic()) else None

    def send_inform(self, header: ToCentral, body: bytes) -> bool:
        """Send an inform directly; return False if the header must go through central."""
        if not self.paths or not isinstance(header, Send):
            return False
        path = self._path_for(header.message)
        return path is not None and path.send_inform(header, body)

    def _path_for(self, message: str) -> DirectPath | None:
        """Return the next path for a message; None if the message must go through central."""
        paths = self._routes.get(message) or deque()
        for _ in range(len(paths)):
            path = paths[0]
            paths.rotate(-1)
            if path.is_usable:
                return path
        return None

    def confirm(self) -> None:
        """Ask the slots which messages have arrived."""
        for path in self.paths.values():
            path.confirm()

    @property
    def unconfirmed(self) -> int:
        """The number of informs that may not have arrived."""
        return sum(path.unconfirmed for path in self.paths.values())

    @property
    def is_restless(self) -> bool:
        """Whether ``listen`` may have something to do although no packet arrives."""
        return any(path.is_restless for path in self.paths.values())

    def listen(self) -> None:
        """Process direct answers and central's routes, and send due packets."""
        now = time.monotonic()
        while self._session.routing:
            self._is_tidy = False
            header = self._session.routing.popleft()
            if isinstance(header, Route):
                paths = map(self._path_to, header.entrances)
                self._routes[header.message] = deque(path for path in paths if path is not None)
            elif isinstance(header, Welcome):
                self._on_welcome(header)
            elif isinstance(header, Barred):
                pass  # for the receiving side
            elif (closing := self.paths.get(header.endpoint)) is not None:
                closing.on_disconnected(header.text, now, lost=header.lost)
        for path in self.paths.values():
            path.receive()
            path.send_due(now)
            while path.complaints:
                self._log.warning("%s", path.complaints.pop())
            self._is_tidy &= not path.is_over
        if not self._is_tidy:
            self._close_unused()

    def _path_to(self, entrance: Entrance) -> DirectPath | None:
        """Return the path to an entrance; None if the entrance can't be reached from here."""
        if self._transport is None:
            return None
        known = self.paths.get(entrance.endpoint)
        if known is not None and not known.is_over:
            known.entrance = entrance  # the licence may have changed
            return known
        try:
            socket = PathSocket(entrance)
        except OSError as error:
            self._log.warning("can't send directly to %s: %s", entrance.endpoint, error)
            return None
        if known is not None:
            self._close(known)
        path = DirectPath(
            entrance,
            socket,
            f"{self._id}/{next(self._numbers)}",
            self._session.module,
            end=self._session.finish,
            hand_over=self._session.adopt,
            lose=self._lose,
        )
        self.paths[entrance.endpoint] = path
        self._transport.add(socket)
        return path

    def _on_welcome(self, header: Welcome) -> None:
        """Forget all routes: central sends them again."""
        is_restarted = bool(self._epoch) and header.epoch != self._epoch
        self._epoch = header.epoch
        self._routes.clear()
        for path in self.paths.values():
            if is_restarted:
                path.lose_all("central was restarted and has forgotten it")
            elif path.is_needed:
                self._session.post(WatchEntrance(path.entrance.endpoint))

    def _lose(self, message: str, number: int, why: str) -> None:
        if why:
            self.lost += number
            what = f"inform{'s' * (number != 1)} '{message}'"
            self._log.warning("%s %s may not have been handled: %s", f"{number:,}", what, why)
        elif not self._has_logged_drops:
            self._has_logged_drops = True
            self._log.warning("informs '%s' are lost: their handler is too slow", message)
        self._notes.add_lost(message, time.monotonic(), number)

    def _close_unused(self) -> None:
        used = {path for paths in self._routes.values() for path in paths if not path.is_over}
        unused = [path for path in self.paths.values() if path not in used]
        for path in unused:
            if not path.is_needed:
                del self.paths[path.entrance.endpoint]
                self._close(path)
        self._is_tidy = not any(path.is_needed for path in unused)

    def _close(self, path: DirectPath) -> None:
        assert self._transport is not None
        self._transport.remove(path.socket)
        path.socket.close()

    def close(self) -> None:
        """Close all paths: nothing is sent directly any more."""
        self._routes.clear()
        for path in self.paths.values():
            self._close(path)
        self.paths.clear()

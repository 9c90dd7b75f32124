"""Client: the connection of a script, which sends messages and handles none."""
# ruff: noqa: SLF001 - clients of several threads close each other

import atexit
import logging
import os
import sys
import threading
from contextlib import ExitStack, suppress
from functools import cache
from itertools import count
from typing import Any, Literal, Self, get_args

import msgspec

from tca_module import checks
from tca_module.checks import check
from tca_module.errors import CentralLost, MisuseError, NotSent, Refused, Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, LINGER, Connection
from tca_module.link.opening import CentralAddress as CentralAddress  # noqa: PLC0414 - exported
from tca_module.link.opening import hello, open_connection
from tca_module.link.waits import PATIENCE
from tca_module.sending.central_services import SentTasks, Topic
from tca_module.sending.handler_errors import crash_text
from tca_module.sending.sender import Sender
from tca_module.sending.sibling_order import SiblingOrder
from tca_module.session.lasting_attachments import LastingAttachments
from tca_wire.packets import headers
from tca_wire.text.measures import listed

OnLeave = Literal["cancel", "keep"]
_ON_LEAVE = checks.one_of("'cancel', 'keep' or None", ("cancel", "keep", None))
_MOST_NAMED = 10
_HINT_WITHIN = 1.0
"""Seconds that central has to say which tasks are open."""

CONNECT_THREADS = "share it with connect(..., threads=True), or connect() in each thread"
_TOPIC = checks.one_of(f"one of {', '.join(get_args(Topic))}", get_args(Topic))


class Client(Sender, checks.OnlyBlocking):
    """A connection of a program that handles no messages. It sends under the root.

    ``connect()`` returns a Client. A Client belongs to the thread that opened it, except with
    ``connect(threads=True)``. Use the Client in a ``with`` block, or call ``close()``.
    """

    def __init__(self, connection: Connection, linger: float = LINGER) -> None:
        super().__init__()
        self._hints = False  #: whether to name open tasks when this client leaves
        self._link: Connection | None = connection
        self._linger = linger
        self._process = os.getpid()
        self._thread = threading.current_thread()
        connection.root_sender = self

    def __repr__(self) -> str:
        return f"client '{self._link.session.module}'" if self._link else "a closed client"

    @property
    def name(self) -> str:
        """The name by which central knows this client."""
        return self._open_link().session.module

    @property
    def address(self) -> str:
        """Central's address."""
        return self._open_link().transport.address

    def status(
        self, topic: Topic = "status", *, timeout: float | None = ACKNOWLEDGED_WITHIN
    ) -> Any:
        """Return central's report on a topic, as plain values (dicts, lists, numbers, texts).

        Args:
            topic: "status", "modules", "messages", "tree", "variables", "load" (how busy handlers
                and central are, and the longest waits) or "attached" (exception handlers, wiretaps
                and monitors, at most 10,000 of each). Default: "status".
            timeout: the most seconds to wait; None waits for ever. Default: 30.

        Raises:
            Timeout: central did not answer in time.
            MisuseError: there is no such topic.

        Example::

            for module in user.status("modules"):
                print(module)
        """
        check("status()", _TOPIC, topic=topic)
        check("status()", checks.TIMEOUT, timeout=timeout)
        return msgspec.msgpack.decode(self._ask_central(topic, timeout))

    def close(self) -> None:
        """Say goodbye to central when all sent messages have arrived. Closing again does nothing.

        This call waits at most *linger* seconds, see ``connect()``.

        Raises:
            NotSent: messages may not have arrived.
            Refused: central refused a sent task, and no other call has raised that error.
        """
        link = self._link
        _open_clients.discard(self)
        if link is not None and link.is_inherited:
            self._link = None  # the process that opened the client says goodbye
        elif link is not None:
            self._name_open_tasks(link)
            try:
                link.close(self._linger)  # may call callbacks, which send with this client
            finally:
                self._link = None

    def _name_open_tasks(self, link: Connection) -> None:
        """Name the top-level tasks that continue without this client, on standard error."""
        can_ask = self._hints and link.has_sent_tasks and link.is_own_thread
        if not (can_ask and link.session.is_welcome):
            return
        self._hints = False
        with suppress(CentralLost, Timeout, Refused):
            asked = headers.Ask(0, "sent")
            request = link.ask_central(asked, "the question for open tasks", within=_HINT_WITHIN)
            sent = msgspec.msgpack.decode(request.answers[-1][1])
            if sent["total"]:
                named = listed(sent["tasks"], sent["total"] - len(sent["tasks"]), named=_MOST_NAMED)
                verb = "continues" if sent["total"] == 1 else "continue"
                print(
                    f"'{self.name}' leaves, and {named} {verb}:"
                    " connect(..., on_leave='cancel') cancels them, on_leave='keep' keeps them",
                    file=sys.stderr,
                )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        link = self._link
        if link is not None:
            link.crash = crash_text(error)
        try:
            self.close()
        except (CentralLost, Refused) as lost:
            if link is None or error is None or (isinstance(error, SystemExit) and not error.code):
                raise
            link.log.error("%s", lost)  # noqa: TRY400 - the other error has the traceback

    @property
    def _is_abandoned(self) -> bool:
        """Whether the thread that opened this client has ended."""
        return self._process == os.getpid() and not self._thread.is_alive()

    def _close_at_exit(self) -> None:
        """Close the client if this process opened it. Raises NotSent if messages may be lost."""
        link, is_own_thread = self._link, self._thread is threading.current_thread()
        if link is None or self._process != os.getpid():
            return
        if not (is_own_thread or self._thread.daemon):
            self._thread.join()
        is_free = is_own_thread or self._is_abandoned
        if is_own_thread:
            self._name_open_tasks(link)
        if is_free or (link.missing and link.acquire_for_closing(self._linger)):
            link.close(self._linger)
        elif number := link.missing:
            where = f"central at {link.transport.address}"
            why = f"thread '{self._thread.name}' still waits, and has not closed its client"
            raise NotSent(
                number, f"{link.count_messages(number)} may not have reached {where}: {why}"
            )

    def _close_from_outside(self) -> None:
        """Close the client of another thread, unless that thread waits with it."""
        if (link := self._link) is None:
            return
        if not link.acquire(self._linger):
            text = f"thread '{self._thread.name}' still waits, and keeps its connection"
            link.log.warning("%s is closed, but %s until it has ended", self, text)
            return
        try:
            self.close()
        finally:
            link.unlock()

    def _open_link(self) -> Connection:
        if self._link is None:
            advice = "use it inside its 'with' block, or connect() again"
            raise MisuseError(f"this client is closed: {advice}")
        return self._link

    def _connection(self) -> Connection:
        link = self._open_link()
        link.check_thread(self, "opened it", CONNECT_THREADS)
        return link


class _SharedClient(Client):
    """A client that any thread may use: each thread has a connection of its own.

    To central, all these connections are one module. The connection of a thread that has ended is
    closed when another thread opens one, and by ``close()``.
    """

    def __init__(self, connection: Connection, linger: float) -> None:
        super().__init__(connection, linger)
        self.central: CentralAddress = None
        self.cancels_on_leave = False
        self._lock = threading.Lock()
        self._numbers = count(1)  #: the numbers of the connections of other threads
        self._others: set[Client] = set()  #: the clients of other threads
        self._of_thread = threading.local()

    def _own(self) -> Client | None:
        """Return the client of the calling thread; None in the thread that opened this one."""
        link = self._open_link()
        link.check_process()
        if link.is_own_thread:
            return None
        own: Client | None = getattr(self._of_thread, "client", None)
        if own is None:
            session = link.session
            greeting = hello(
                self.name,
                next(self._numbers),
                incarnation=session.incarnation,
                cancels_on_leave=self.cancels_on_leave,
            )
            patience = link.wait_loop.patience
            own = self._of_thread.client = _open(
                Client, self.central, greeting, patience, self._linger, session.attachments
            )
            with self._lock:
                self._others = {one for one in self._others if one._link is not None} | {own}
        return own

    def _connection(self) -> Connection:
        own = self._own()
        return super()._connection() if own is None else own._connection()

    @property
    def _ordering(self) -> SiblingOrder:
        own = self._own()
        return super()._ordering if own is None else own._ordering

    @property
    def _sent(self) -> SentTasks:
        own = self._own()
        return super()._sent if own is None else own._sent

    @property
    def _is_abandoned(self) -> bool:
        """Always False: the other threads may still use it."""
        return False

    def close(self) -> None:
        """Close the connections of all threads, see ``Client.close``.

        A thread that waits at this time keeps its connection until it has ended.
        """
        with ExitStack() as stack:
            stack.callback(super().close)
            if self._link is not None and not self._link.is_inherited:
                for other in self._others:
                    stack.callback(other._close_from_outside)


def connect(
    name: str = "script",
    central: CentralAddress = None,
    patience: float = PATIENCE / 2,
    *,
    linger: float = LINGER,
    threads: bool = False,
    on_leave: OnLeave | None = None,
) -> Client:
    """Connect to central from a program that is no module.

    The end of the ``with`` block waits until all sent messages have arrived. Goals and commands
    that were sent continue, unless *on_leave* says otherwise.

    Args:
        name: the name by which central knows the client, 1 to 128 printable characters. Default:
            "script".
        central: an address such as "tcp://rover:7400", or several with commas, of which one central
            leads; or a ``LocalCentral``. Default: None, which means ``$TCA_CENTRAL`` or else the
            default socket.
        patience: the seconds to wait for central here; also the seconds of central's silence after
            which a later wait raises CentralLost, and with several addresses at least 30.
            Default: 5.
        linger: the most seconds that the end of the block waits for sent messages to arrive.
            Default: 10.
        threads: any thread may use the client. Each thread opens a connection of its own at its
            first call, and the client's tasks belong to the thread that sent or found them.
            Default: False.
        on_leave: "cancel" has central request the cancel of the client's living goals and commands
            when the client leaves, also when its process dies. "keep" lets them continue. Default:
            None, which also lets them continue, and names them on standard error.

    Returns:
        The Client.

    Raises:
        CentralLost: no central answered within *patience* seconds.
        Refused: central does not admit this program.
        NotSent: at the end of the block, messages may not have arrived.
        MisuseError: an argument has the wrong type or range.

    Example::

        with connect("operator") as user:
            user.goal(WALK, path).wait(timeout=60)
    """
    check("connect()", checks.NAME, name=name)
    check("connect()", checks.PATIENCE, patience=patience, linger=linger)
    check("connect()", checks.FLAG, threads=threads)
    check("connect()", _ON_LEAVE, on_leave=on_leave)
    greeting = hello(name, cancels_on_leave=on_leave == "cancel")
    client = _open(_SharedClient if threads else Client, central, greeting, patience, linger)
    client._hints = on_leave is None and (central is None or isinstance(central, str))
    if isinstance(client, _SharedClient):
        client.central, client.cancels_on_leave = central, greeting.cancels_on_leave
    return client


def _open(
    kind: type[Client],
    central: CentralAddress,
    greeting: headers.Hello,
    patience: float,
    linger: float,
    attachments: LastingAttachments | None = None,
) -> Client:
    """Open a client of a kind, which is closed at the end of the program at the latest."""
    try:
        connection = open_connection(central, greeting, patience, attachments=attachments)
        client = kind(connection, linger)
    except CentralLost as error:
        # Without its cause: a script that does not catch the error prints a short traceback.
        raise CentralLost(str(error)) from None
    _close_abandoned()
    _open_clients.add(client)
    _close_at_end_of(os.getpid())
    return client


_open_clients: set[Client] = set()
"""The clients that have not been closed."""


def _close_abandoned() -> None:
    """Close the clients whose threads have ended, so that they do not accumulate."""
    for client in [one for one in list(_open_clients) if one._is_abandoned]:
        try:
            client._close_from_outside()  # other threads may close it, too
        except (CentralLost, Refused) as lost:
            logging.getLogger("tca").error("%s", lost)  # noqa: TRY400 - no caller could catch it


def _close_all() -> str:
    """Close all clients. Returns a line for each that may have lost messages."""
    lost = []
    while _open_clients:
        try:
            _open_clients.pop()._close_at_exit()
        except (CentralLost, Refused) as error:
            lost.append(str(error))
    return "\n".join(lost)


@atexit.register
def _at_exit() -> None:
    """Close the clients that are still open at the end of the program.

    If messages may be lost, this ends the process with exit code 1, because an error raised here
    would not change the exit code.
    """
    if lost := _close_all():
        logging.shutdown()
        print(lost, file=sys.stderr)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(1)


@cache
def _close_at_end_of(_process: int) -> None:
    """Register the closing of clients for the end of a ``multiprocessing`` process.

    These processes may end without ``atexit``.
    """
    processes: Any = sys.modules.get("multiprocessing.process")
    if processes is not None and processes.parent_process() is not None:
        sys.modules["multiprocessing.util"].Finalize(None, _at_end_of_child, exitpriority=_LAST)


_LAST = -100
"""The priority of a finalizer that runs last: after the queues are emptied, for example."""


def _at_end_of_child() -> None:
    """Close the clients that are still open at the end of a ``multiprocessing`` process.

    If messages may be lost, this exits with an error, which changes the exit code here.
    """
    if lost := _close_all():
        sys.exit(lost)

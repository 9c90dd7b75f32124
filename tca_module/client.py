"""Client: a script that handles nothing sends with it."""

import atexit
import logging
import os
import sys
import threading
from functools import cache
from typing import Any, Self, get_args

import msgspec

from tca_module import checks
from tca_module.checks import check
from tca_module.errors import CentralLost, MisuseError, NotSent, Refused
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, LINGER, Connection
from tca_module.link.opening import CentralAddress, hello, open_connection
from tca_module.link.waits import PATIENCE
from tca_module.sending.central_services import Topic
from tca_module.sending.sender import Sender

_TOPIC = checks.one_of(f"one of {', '.join(get_args(Topic))}", get_args(Topic))


class Client(Sender):
    """A connection of a program that handles nothing; it sends under the root. For one thread."""

    def __init__(self, connection: Connection, linger: float = LINGER) -> None:
        super().__init__()
        self._link: Connection | None = connection
        self._linger = linger
        self._process = os.getpid()
        self._thread = threading.current_thread()
        connection.root_sender = self

    def __repr__(self) -> str:
        return (
            f"client '{self._link.session.module}'" if self._link is not None else "a closed client"
        )

    @property
    def name(self) -> str:
        """The name under which central knows this client."""
        return self._opened().session.module

    @property
    def address(self) -> str:
        """Central's address."""
        return self._opened().transport.address

    def status(
        self, topic: Topic = "status", *, timeout: float | None = ACKNOWLEDGED_WITHIN
    ) -> Any:
        """Central's report on a topic, as plain values: "status", "modules", "messages", "tree",
        "variables", "load" (how busy everything is, and the longest waits) or "attached" (exception
        handlers, wiretaps and monitors, at most 10,000 of each). Raises Timeout.
        """
        check("status()", _TOPIC, topic=topic)
        check("status()", checks.TIMEOUT, timeout=timeout)
        return msgspec.msgpack.decode(self._ask_central(topic, timeout))

    def close(self) -> None:
        """Say goodbye to central when all that was sent has arrived. Raises NotSent if something
        may not have, Refused if a task that was sent was refused; twice does no harm.
        """
        link = self._link
        _open.discard(self)
        if link is not None and link.is_inherited:
            self._link = None  # the process that opened it says goodbye
        elif link is not None:
            try:
                link.close(self._linger)  # it may call functions, which send with this
            finally:
                self._link = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        link = self._link
        try:
            self.close()
        except (CentralLost, Refused) as lost:
            if link is None or error is None or (isinstance(error, SystemExit) and not error.code):
                raise
            link.log.error("%s", lost)  # noqa: TRY400 - the other error has the traceback

    @property
    def _is_abandoned(self) -> bool:
        """Whether the thread that opened it has ended."""
        return self._process == os.getpid() and not self._thread.is_alive()

    def _close_at_exit(self) -> None:
        """Close it, if it is of this process. Raises NotSent if something may be lost."""
        link, is_mine = self._link, self._thread is threading.current_thread()
        if link is None or self._process != os.getpid():
            return
        if not (is_mine or self._thread.daemon):
            self._thread.join()
        if is_mine or self._is_abandoned or (link.missing and link.take_over(self._linger)):
            link.close(self._linger)
        elif number := link.missing:
            where = f"central at {link.transport.address}"
            why = f"thread '{self._thread.name}' still waits, and has not closed its client"
            raise NotSent(number, f"{link.messages(number)} may not have reached {where}: {why}")

    def _opened(self) -> Connection:
        if self._link is None:
            raise MisuseError(
                "this client is closed: use it inside its 'with' block, or connect() again"
            )
        return self._link

    def _connection(self) -> Connection:
        link = self._link or self._opened()
        link.check_thread(self, "opened it", "in other threads connect() anew")
        return link


def connect(
    name: str = "script",
    central: CentralAddress = None,
    patience: float = PATIENCE / 2,
    *,
    linger: float = LINGER,
) -> Client:
    """Connect to central from a program that is no module.

    Raises CentralLost if no central answers within *patience* seconds. The end of its ``with``
    block waits until all that was sent has arrived, at most *linger* seconds; it raises NotSent if
    something may not have.
    """
    check("connect()", checks.NAME, name=name)
    check("connect()", checks.PATIENCE, patience=patience, linger=linger)
    try:
        client = Client(open_connection(central, hello(name), patience), linger)
    except CentralLost as error:
        raise CentralLost(
            str(error)
        ) from None  # a short traceback: what a script shows that does not catch it
    _close_abandoned()
    _open.add(client)
    _close_at_end_of(os.getpid())
    return client


_open: set[Client] = set()
"""Those that nobody has closed."""


def _close_abandoned() -> None:
    """Close the clients whose threads have ended, so that they do not pile up."""
    for client in [client for client in list(_open) if client._is_abandoned]:  # noqa: SLF001
        try:
            client.close()
        except (CentralLost, Refused) as lost:
            logging.getLogger("tca").error("%s", lost)  # noqa: TRY400 - nobody here could catch it


def _close_all() -> str:
    """Close all clients; what may be lost, a line each."""
    lost = []
    while _open:
        try:
            _open.pop()._close_at_exit()  # noqa: SLF001
        except (CentralLost, Refused) as error:
            lost.append(str(error))
    return "\n".join(lost)


@atexit.register
def _at_exit() -> None:
    """Close the clients that nobody has closed. If messages may be lost, end the process with exit
    code 1: an error would not change the exit code here.
    """
    if lost := _close_all():
        logging.shutdown()
        print(lost, file=sys.stderr)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(1)


@cache
def _close_at_end_of(_process: int) -> None:
    """Do the same at the end of a process of ``multiprocessing``, which may end without
    ``atexit``.
    """
    processes: Any = sys.modules.get("multiprocessing.process")
    if processes is not None and processes.parent_process() is not None:
        sys.modules["multiprocessing.util"].Finalize(None, _at_end_of_child, exitpriority=_LAST)


_LAST = -100
"""The priority of what is done when all else is: queues, for example, are emptied before."""


def _at_end_of_child() -> None:
    """As above; an error does change the exit code of such a process."""
    if lost := _close_all():
        sys.exit(lost)

"""The address of a replicated log."""

import re
from urllib.parse import unquote, urlsplit

_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
_SERVER = re.compile(r"([^@]+@)?(\[[0-9a-fA-F:]+\]|[^@:\[\]\s]+)(:[0-9]{1,5})?")
_SECRET = re.compile(r"((?:nats|tls)://|,)[^,]*@")


def log_in(address: str) -> tuple[list[str], str]:
    """Return the servers and the name in the address of a log.

    The user of the first server is that of all servers without one. Raises ValueError.

    Example:
        >>> log_in("nats://10.0.0.1:4222,10.0.0.2/rover")
        (['nats://10.0.0.1:4222', 'nats://10.0.0.2'], 'rover')
    """
    scheme, _, rest = address.partition("://")
    servers, _, name = rest.partition("/")
    found = [one.strip() for one in servers.split(",") if one.strip()]
    is_right = scheme in ("nats", "tls") and found and all(map(_is_server, found))
    if not is_right or not _NAME.fullmatch(name := name or "robot"):
        msg = (
            f"'{without_secrets(address)}' is not the address of a log: "
            "use nats://host:port,host:port/NAME, with letters, digits, - and _ in NAME"
        )
        raise ValueError(msg)
    user, at, _ = found[0].partition("@")
    return [f"{scheme}://{one if at in one else user + at + one}" for one in found], name


def _is_server(text: str) -> bool:
    found = _SERVER.fullmatch(text)
    return found is not None and int((found[3] or ":1")[1:]) < 65536


def user_in(server: str) -> tuple[str | None, str | None]:
    """Return the user, or token, and the password in the address of a server.

    Example:
        >>> user_in("nats://rover:secret@10.0.0.1")
        ('rover', 'secret')
    """
    url = urlsplit(server)
    user, password = url.username, url.password
    return unquote(user) if user else None, unquote(password) if password else None


def without_secrets(address: str) -> str:
    """Return the address of a log without users and passwords.

    Example:
        >>> without_secrets("nats://rover:secret@10.0.0.1,10.0.0.2/rover")
        'nats://10.0.0.1,10.0.0.2/rover'
    """
    return _SECRET.sub(r"\1", address)

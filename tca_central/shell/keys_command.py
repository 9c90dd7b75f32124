"""``tca keys``: makes, lists and revokes the keys of programs that connect over a network."""

import shlex
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click

from tca_central.shell.allowed_keys import (
    PUBLIC,
    allowed_folder,
    make_folder,
    names_allowed,
    own_pair,
    write_new,
)
from tca_central.shell.authenticator import new_pair
from tca_wire.errors import KeyRefused
from tca_wire.keys import (
    DEFAULT,
    FOLDER_VARIABLE,
    SUFFIX,
    VARIABLE,
    check_key,
    check_name,
    keys_folder,
    read_client_key,
)

_FOLDER = click.option(
    "--folder",
    type=click.Path(path_type=Path),
    help=f"The folder of keys [default: ${FOLDER_VARIABLE}, else ~/.config/tca/keys].",
)


def _with_folder(command: Callable[..., None]) -> Callable[..., None]:
    """Add the option --folder to a command, and show its KeyRefused as an error of the user."""

    @wraps(command)
    def wrapped(folder: Path | None, **given: Any) -> None:
        try:
            command(folder=folder or keys_folder(), **given)
        except KeyRefused as error:
            raise click.ClickException(str(error)) from None

    return _FOLDER(wrapped)


@click.group()
def keys() -> None:
    """Keys for centrals that other machines can reach.

    On central's machine: 'tca keys new arm' makes a key, 'tca central --bind tcp://0.0.0.0:5555'
    asks for it. Copy arm.key to the other machine (with scp) and run 'tca keys use arm.key' there;
    or name it in $TCA_KEY.
    """


@keys.command()
@click.argument("name")
@click.option(
    "--central",
    metavar="PUBLIC",
    help="For a central elsewhere, by its public key ('tca keys list' there).",
)
@_with_folder
def new(folder: Path, name: str, central: str | None) -> None:
    """Make a key for the program (or person, or machine) NAME, and allow it."""
    check_name(name)
    if central is not None:
        check_key(central)
        make_folder(folder)
    if (allowed_folder(folder) / f"{name}{PUBLIC}").exists():
        raise KeyRefused(
            f"'{name}' has a key: choose another name, or 'tca keys revoke {name}' first"
        )
    pair, path = new_pair(), folder / f"{name}{SUFFIX}"
    lines = (
        f"# The key of '{name}'. Secret: a program that has it is '{name}'.",
        f'name = "{name}"',
        f'public = "{pair.public}"',
        f'secret = "{pair.secret}"',
        f'central = "{central or own_pair(folder).public}"',
    )
    write_new(
        path,
        "".join(f"{line}\n" for line in lines),
        "choose another name, or remove that file of a revoked key",
    )
    click.echo(str(path))
    if central is None:
        _allow(folder, name, pair.public)
    else:
        click.echo(f"allow it where central runs: tca keys allow {name} '{pair.public}'")


@keys.command()
@click.argument("name")
@click.argument("public")
@_with_folder
def allow(folder: Path, name: str, public: str) -> None:
    """Allow a key that was made elsewhere, by its PUBLIC half."""
    check_name(name)
    check_key(public)
    make_folder(folder)
    _allow(folder, name, public)


def _allow(folder: Path, name: str, public: str) -> None:
    """Allow a key. Raises KeyRefused if another name has it."""
    if (other := names_allowed(folder).get(public)) is not None:
        raise KeyRefused(f"that is the key of '{other}': give each program a key of its own")
    write_new(allowed_folder(folder) / f"{name}{PUBLIC}", f"{public}\n")


@keys.command(name="list")
@_with_folder
def list_keys(folder: Path) -> None:
    """List central's own public key, and the names and public keys that it allows."""
    own = own_pair(folder)
    rows = [
        ("(central)", own.public),
        *((name, public) for public, name in names_allowed(folder).items()),
    ]
    width = max(len(name) for name, _ in rows)
    for name, public in rows:
        click.echo(f"{name:{width}}  {public}")


@keys.command()
@click.argument("name")
@_with_folder
def revoke(folder: Path, name: str) -> None:
    """Admit NAME no more. A running central cuts its connections within a second."""
    check_name(name)
    path = allowed_folder(folder) / f"{name}{PUBLIC}"
    if not path.exists():
        raise KeyRefused(f"no key '{name}' is allowed: 'tca keys list' shows those that are")
    public = path.read_text().strip()
    path.unlink()
    click.echo(
        f"'{name}' is revoked; 'tca keys allow {name} {shlex.quote(public)}' allows it again"
    )
    if (secret := folder / f"{name}{SUFFIX}").exists():
        click.echo(
            f"its key is still in {secret}: remove that file before you make a key for '{name}'"
        )


@keys.command()
@click.argument("file", type=click.Path(path_type=Path))
@_with_folder
def use(folder: Path, file: Path) -> None:
    """Let programs of this user use the key in FILE, unless $TCA_KEY names another."""
    if not file.exists():
        raise KeyRefused(f"there is no {file}")
    if file.stat().st_mode & 0o077:
        file.chmod(0o600)  # scp makes it readable by others
    key = read_client_key(file)
    make_folder(folder)
    write_new(folder / f"{DEFAULT}{SUFFIX}", file.read_text(), "move it away first")
    click.echo(
        f"programs of this user are '{key.name}' from now on; "
        f"set ${VARIABLE} to use another key for one of them"
    )


if __name__ == "__main__":
    keys(prog_name="tca keys")

"""Links over real loopback sockets that drop half of the links' datagrams."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from turtles.towns import until_known

from robots.turtle_sim.errors import BadTeam
from robots.turtle_sim.sync.link import StatusLink
from robots.turtle_sim.sync.task_server import main
from robots.turtle_sim.sync.team import free_team, load_team, save_team

NAMES = ("a", "b", "c")


@contextmanager
def links(loss: float) -> Iterator[dict[str, StatusLink]]:
    with ExitStack() as stack:
        team = free_team(*NAMES)
        yield {name: stack.enter_context(StatusLink(name, team, loss=loss)) for name in NAMES}


def test_link_delivers_all_when_half_of_the_datagrams_are_lost() -> None:
    with links(loss=0.5) as made:
        for status in range(1, 6):
            made["a"].set_status(status)
            for name in ("b", "c"):
                until_known(made[name], "a", status)
        assert sum(link.lost for link in made.values()) > 5


def test_link_ignores_strangers_and_noise() -> None:
    with links(loss=0.0) as made, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for noise in (b"", b"noise", bytes(20_000)):
            stranger.sendto(noise, made["a"]._own_address)
        for noise in (b"noise of a partner", b"\x93\xa4\x00\x00\x00\x80"):
            made["b"]._send("a", noise)
        made["b"].set_status(4)
        until_known(made["a"], "b", 4)


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ('a = "127.0.0.1"', "the address of 'a' is HOST:PORT"),
        ('a = "127.0.0.1:70000"', "the address of 'a' is HOST:PORT"),
        ("a = 7500", "the address of 'a' is HOST:PORT"),
        ('a = "nowhere.invalid:1"', r"the host 'nowhere\.invalid' of 'a' does not exist"),
        ("a = ", r"team\.toml can't be read"),
    ],
)
def test_unusable_team_says_why(tmp_path: Path, line: str, error: str) -> None:
    file = tmp_path / "team.toml"
    file.write_text(line)
    with pytest.raises(BadTeam, match=error):
        load_team(file)


def test_team_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "team.toml"
    file.write_text('a = "localhost:7501"\n"b 2" = "10.0.0.7:7502"')
    assert load_team(file) == {"a": ("127.0.0.1", 7501), "b 2": ("10.0.0.7", 7502)}


@pytest.mark.parametrize(
    ("name", "team", "error"),
    [
        ("a", "none.toml", "the team's file none.toml can't be read"),
        ("c", "team.toml", "'c' is not in the team: its members are a, b"),
        ("b", "team.toml", "'b' can't listen at 127.0.0.1:"),
    ],
)
def test_unlinkable_task_server_says_why(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    team: str,
    error: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["task_server", name, team])
    addresses = free_team("a", "b")
    save_team(addresses, Path("team.toml"))
    with StatusLink("b", addresses), pytest.raises(SystemExit, match="2"):
        main()
    assert error in capsys.readouterr().err

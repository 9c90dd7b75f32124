"""Links of real sockets on the loopback, half of whose datagrams are thrown away."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

from robots.turtle_sim.errors import NoSuchPartner
from robots.turtle_sim.sync.link import Address, StatusLink

NAMES = ("a", "b", "c")


def free_addresses() -> dict[str, Address]:
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in NAMES]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return dict(zip(NAMES, (one.getsockname() for one in sockets), strict=True))


@contextmanager
def links(loss: float) -> Iterator[dict[str, StatusLink]]:
    addresses = free_addresses()
    with ExitStack() as stack:
        made = {}
        for name in NAMES:
            others = {other: ("localhost", port) for other, (_, port) in addresses.items() if other != name}
            made[name] = stack.enter_context(StatusLink(name, others, loss=loss, seed=7))
            made[name].open(addresses[name])
        yield made


def test_everything_arrives_though_half_of_the_datagrams_are_lost() -> None:
    with links(loss=0.5) as made:
        for status in range(1, 6):
            made["a"].set_status(status)
            assert made["a"].wait_until_told(30)
            assert [made[name].status("a") for name in ("b", "c")] == [status, status]
        assert sum(link.lost for link in made.values()) > 5


def test_a_partner_that_never_comes_is_named() -> None:
    with StatusLink("a", {"b": ("127.0.0.1", 9)}) as link:
        link.open(("127.0.0.1", 0))
        link.set_status(1)
        assert not link.wait_until_told(0.01)
        assert link.status("b") is None
        assert link.words("b").startswith("nothing was ever heard of 'b'")
        with pytest.raises(NoSuchPartner, match="its partners are b"):
            link.status("z")


def test_strangers_and_noise_are_ignored() -> None:
    with links(loss=0.0) as made, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        address = made["a"].address
        for noise in (b"", b"noise", bytes(20_000)):
            stranger.sendto(noise, address)
        made["b"]._send("a", b"noise of a partner")
        made["b"].set_status(4)
        assert made["b"].wait_until_told(30)
        assert made["a"].status("b") == 4


def test_two_links_need_two_addresses() -> None:
    with links(loss=0.0) as made, StatusLink("d", {}) as other, pytest.raises(OSError, match="in use"):
        other.open(made["a"].address)


def test_a_host_without_an_address_is_named() -> None:
    with pytest.raises(OSError, match="no address is known for host 'nowhere\\.invalid' of 'b'"):
        StatusLink("a", {"b": ("nowhere.invalid", 1)})

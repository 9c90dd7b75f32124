"""Robots that exchange their statuses over a link that loses datagrams."""

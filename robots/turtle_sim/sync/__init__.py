"""Robots that tell each other how far they are, over a link that loses datagrams."""

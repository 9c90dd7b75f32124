"""Packets that no request asks for: central's own messages, copies and notices."""

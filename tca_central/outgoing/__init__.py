"""Packets that no request asks for: central's own messages, copies, notices and routes."""

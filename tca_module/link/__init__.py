"""Connections to central: opening and closing them, requests, waits, and keeping them alive."""

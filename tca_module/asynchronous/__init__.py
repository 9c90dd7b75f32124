"""Clients and handlers on the user's own asyncio event loop."""

"""Waits that can never end: the graph of who waits for whom, the search, and what is done about it."""

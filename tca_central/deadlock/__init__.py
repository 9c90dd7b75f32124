"""Waits that can never end: the search for them in the graph of needs, and the remedy."""

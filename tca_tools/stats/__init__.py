"""Statistics of a run: the number of messages, their times and waits, and the use of resources."""

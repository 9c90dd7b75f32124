"""One run of a scenario, action by action."""

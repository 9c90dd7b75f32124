"""One run of a scenario, played action by action."""

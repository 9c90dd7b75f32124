"""The state of a run, derived from the facts that central records."""

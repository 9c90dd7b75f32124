"""The state of a run from the facts that central records."""

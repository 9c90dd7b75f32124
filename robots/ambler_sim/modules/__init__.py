"""The Ambler's modules, a process each. None of them names another."""

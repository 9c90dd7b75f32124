"""The Ambler's modules, a process each; none of them names another."""

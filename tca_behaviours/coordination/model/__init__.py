"""Machines of activities: as written, as data, as an automaton with likelihoods, and running."""

"""Machines of activities: as they are written, as data, as an automaton with likelihoods, and at
work.
"""

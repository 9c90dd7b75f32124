"""A run as a Perfetto trace: which tracks there are and what is on them (pure), and how that is
written.
"""

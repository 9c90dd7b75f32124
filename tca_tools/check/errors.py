"""What the check of a journal raises."""


class BadProperty(ValueError):
    """A text that is no property; its message says what, which and what to do."""

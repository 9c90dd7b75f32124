"""A run as one page to mail to a colleague."""

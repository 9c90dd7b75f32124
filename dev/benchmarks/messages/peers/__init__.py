"""Other programs' contestants. Each file imports what it needs, so it is loaded only where that is
installed.
"""

"""Looking ahead: the states that are likely to follow, and which of their activities may start now.

Pure: it depends only on its arguments.
"""

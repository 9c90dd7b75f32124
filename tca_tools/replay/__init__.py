"""``tca replay``: a run message by message in the terminal, forwards or backwards."""

"""``tca console``: run the tasks of a server by typing them."""

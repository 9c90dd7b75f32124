"""``tca console``: the tasks of a server, typed by a person."""

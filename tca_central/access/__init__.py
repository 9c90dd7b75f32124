"""Who may do what: the permissions that each request needs."""

"""Direct messages: informs and queries that go from module to module, without central."""

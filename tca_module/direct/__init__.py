"""Messages that go from module to module without central."""

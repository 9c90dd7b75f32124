"""Messages that go to their handler without central."""

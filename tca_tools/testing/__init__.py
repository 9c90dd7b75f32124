"""The plugin for pytest: a central for each test, in its process or as a daemon."""

"""The server of tasks: definitions, parameters, runs."""

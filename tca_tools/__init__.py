"""The command ``tca`` and its tools: they read journals of runs, steer a live run, test robots."""

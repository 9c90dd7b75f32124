"""Control of running tasks: kills, suspension, deadlines, monitors, retention, revoked locks."""

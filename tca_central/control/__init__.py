"""Control of running tasks: kills, suspension, deadlines, monitors, keeping, revoked locks."""

"""What steers running tasks: kills, suspension, deadlines, monitors, keeping, revoked locks."""

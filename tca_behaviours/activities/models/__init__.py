"""Models of applications: TOML files that are checked, drawn, and converted to Python."""

"""Models of applications: TOML files that are checked, drawn, and turned into Python."""

"""Contestants of other programs. Each file is loaded only where its packages are installed."""

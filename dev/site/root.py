"""The folders of the site."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
SITE = ROOT / "build" / "site"
PARTS = ROOT / "build" / "parts"
"""The generated parts of pages, which the pages quote."""

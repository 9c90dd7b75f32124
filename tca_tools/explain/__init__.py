"""Why tasks wait, and what became of them."""

"""Images: the whole state of central as bytes, from which central continues after a restart."""

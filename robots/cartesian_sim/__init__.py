"""A Cartesian robot that cleans a wall: two axes and a tool, each a joint with four regions."""

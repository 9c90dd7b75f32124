"""Later additions to the robot. The programs in `modules` do not know them."""

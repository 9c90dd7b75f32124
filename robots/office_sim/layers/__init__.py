"""What was added to the robot later: the programs in `modules` have never heard of these."""

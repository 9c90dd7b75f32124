"""Components whose statecharts run their activities on periodic threads, allocated at run time."""

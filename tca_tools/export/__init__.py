"""A run in the formats of other tools: Perfetto, Foxglove, notebooks and spreadsheets."""

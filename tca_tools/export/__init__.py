"""Exports of a run in the formats of other tools: Perfetto, Foxglove, notebooks, spreadsheets."""

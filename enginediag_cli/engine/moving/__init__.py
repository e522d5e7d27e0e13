"""Engines that move, on recordings: what an engine remembers is a filter along the time of the record."""

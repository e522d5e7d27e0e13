"""Blind trials of laws: effects that no library holds."""

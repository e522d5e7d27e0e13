"""Blind trials of isolation: an engine is made, flown and changed; another process isolates; a scorer marks it."""

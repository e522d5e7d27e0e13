"""Trials with known truth: Monte-Carlo studies of diagnosis, and blind trials of the search for missing physics."""

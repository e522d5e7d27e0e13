"""Fits: evidence, everything that is identified together, and scores of what may be missing."""

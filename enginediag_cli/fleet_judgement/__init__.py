"""Judging a fleet: what each engine's history says, which engines stand out, and what is common to all."""

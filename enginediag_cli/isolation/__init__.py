"""Isolation: which parameters changed, by how much, and which other explanations the data leave open."""

"""What is missing: listed effects, changes in time, curves, and what cannot be told."""

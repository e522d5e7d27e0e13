"""The methods that a study compares, one per file."""

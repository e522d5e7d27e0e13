"""Truths that are not the model: engines on tabulated maps, and instruments as they are. One kind of error per file."""

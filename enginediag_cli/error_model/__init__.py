"""The error model: how wrong the maps of an engine may be, what that does to a prediction, and how large it is.

It wraps an engine and adds the amounts of map errors as parameters (`maps.py`). It estimates their standard deviations
from training records (`sizes.py`). Open `maps.MapErrorModel` first.
"""

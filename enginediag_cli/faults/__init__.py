"""The catalogue of faults: component faults, sensor faults, and how they grow with time.

It reads fault files and gives a `FaultSet`: the parameters of the engine at every record, and what happens to readings.
`catalogue.py` is all of it.
"""

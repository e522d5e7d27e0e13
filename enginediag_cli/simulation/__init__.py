"""Simulated recordings: flights, faults and sensor noise → what an engine would have recorded.

It reads a flight file, an engine and a `FaultSet`, and gives recordings with their truth. A newcomer opens
`simulate.py` first, then `flights.py` (the flight file and the noise) and `missions.py` (the kinds of flights).
"""

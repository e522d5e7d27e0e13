"""Recordings, recorder, engine and nominal state come in here, for every command and library user alike.

Nothing here knows of a terminal. What was masked, excluded or missing is data, reported by `report`.
"""

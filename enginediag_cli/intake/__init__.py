"""The one door: recordings, recorder, engine and nominal state come in here, for every command and library user alike.

Nothing here knows of a terminal. What was masked, left out or missing is data (`LeftOut`), told by presentation.
"""

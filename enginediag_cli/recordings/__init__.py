"""Recordings: tables of readings over time, from files of any recorder to columns that the engine model uses.

Files are read as they are (`source.py`, `read.py`) into a `Recording` (`table.py`). A `Recorder` (`recorder.py`, its
YAML in `recorder_file.py`) maps foreign columns, units and clocks; `masking.py` and `repeated.py` exclude readings that
cannot be right, and count them. `draft.py` drafts a recorder for an unknown file. Open first: `table.py`, then
`recorder.py`.
"""

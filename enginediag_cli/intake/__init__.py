"""Intake: recordings, recorder, engine and nominal state become masked flights, for every command and library user.

It reads what `selection.py` names and gives chunks or whole flights (`loader.py`) with counts of what was excluded, and
the verdict whether a recording can be of this engine (`agreement.py`), with the mistake if not (`mistakes.py`). Nothing
here knows of a terminal: excluded data are data, which `report` shows. Open first: `loader.py`.
"""

"""YAML files: read with positions, validated by one declaration of their keys, refused with file, line and column.

The input is a path. The result is `Checked`: plain values with defaults filled in, and the place of each value, so that
later checks can report a problem where it is. Open first: `fields.py` (how keys are declared), then `validate.py`
(`load_checked`, the kinds of file). `document.py` reads, writes and edits YAML 1.2; `files.py` decides which files a
run may read.
"""

"""Physical effects that an engine model may have or lack: the library in `terms/`, and laws of engine files.

The package gives effects for an engine's network, from the `physics:` block of its file or for a search of missing
physics. A newcomer opens `registry.py` first (the library by name), then one family in `terms/`, then `engine_file.py`
(`load_engine`) and `law.py` (effects that a formula states).
"""

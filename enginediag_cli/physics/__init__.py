"""Physical effects that an engine model may carry or lack: the library in `terms/`, and laws of engine files."""

"""Physical effects that an engine model may carry or lack: the library in `terms/`, and laws that engine files state."""

"""Physical effects that an engine model may carry or lack: one effect per file in `terms/`."""

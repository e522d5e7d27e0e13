"""The next recording: flights that an engine may fly, and how soon each would tell rival explanations apart."""

"""The next recording: flights that an engine may fly, and how soon each would separate alternative hypotheses."""

"""Residuals: from measured minus predicted to the local statistics (s, F, V, N) that every test reads."""

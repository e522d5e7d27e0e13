"""Residuals: from measured minus predicted to the local statistics (s, F, V, N) that every test reads.

It reads recordings and a `Monitor` (`monitor.py`: what is monitored, and all that is uncertain about nominal) and gives
one `WindowStatistics` for each window (`windows.py`). Open first: `statistics.py` (the equations), `pipeline.py` (from
records to windows), then `score.py` (the form in which tests use them). `files.py` does it for files, and reads
statistics back that `residual` wrote.
"""

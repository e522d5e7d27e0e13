"""Detection: whether anything changed, how surely, and how small a change these data would have shown.

It reads the statistics of windows (`residuals.windows.WindowStatistics`), or the blocks of a flight that is being
recorded, and gives a `Verdict`, an e-value with a false-alarm probability that holds for the whole flight, or the
forecast of a margin.

Open first: `verdict` (the test of one window), `sequential` (e-values over the records of a flight), `series` (flights
of an engine in order), `follow` (a flight while it is recorded), `forecast` (when a margin is used up).
"""

"""Isolation: which parameters changed, by how much, how surely, and which alternatives the data leave open.

It reads the score and information of a window (`residuals.score.Score`) and gives a `SetIsolation`. `IsolatedWindow` is
the answer for one window with its verdict.

Open first: `prior` (what is assumed before the data), `posterior` (probability of every set of changed parameters),
`diagnosis` (the answer for one window), `windows` (the windows of recordings, one after the other). `nonlinear` treats
large changes; `catalogue` named faults; `results` what is returned, and what to record next; `planned_flights` on
which flight; `sensitivity_analysis` which error would change the conclusion.
"""

"""Identification: the nominal state of an engine, and the noise of its instruments, from healthy recordings.

It reads training recordings and an engine, and gives an `Identification`, whose `nominal()` is the `Nominal` that later
stages measure departures from. Open first: `identify.py` (the whole of it), `problem.py` (what is estimated and what is
known before), `passes.py` (fit, noise and map errors in turn) and `gauss_newton.py` (the fit). `nominal.py` and
`nominal_file.py` contain the result and its file.
"""

"""Handling bleed that closes at a higher speed than it opens at."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters import Hysteresis, Scaled
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place
from enginediag_cli.physics.terms.handling_bleed import OPEN_BELOW, CompressorValve, Share


class BleedValveHysteresis(CompressorValve):
    """W = W_exit (1 − b) while n_open ≤ n < n_open + Δn after n < n_open, n = N_c/N_c,design of the site's compressor.

    What a valve bleeds below n_open is another effect (`handling_bleed`), which needs no memory. No search tries it: it
    jumps where nobody knows its thresholds. What it does in a recording is found as a switch that no column records,
    whose states say what it follows and between which thresholds.
    """

    NAME = "bleed_valve_hysteresis"
    TITLE = "Bleed valve that closes later than it opens"
    STATEMENT = (
        "A valve that was open at low speed stays open until a higher speed than that at which it opens: in between "
        "the engine bleeds after an acceleration, and does not after a deceleration."
    )
    EQUATION = "W = W_exit (1 − b)  while n_open ≤ N_c/N_c,design < n_open + Δn, having come from below"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient("fraction", "1", "b, bleed over flow while the valve is still open", 0.0, 0.0, 0.25, 0.05, 0.05),
        replace(OPEN_BELOW, description="n_open, relative corrected speed below which the valve opens"),
        Coefficient(
            "band",
            "1",
            "Δn, by how much higher it closes",
            0.05,
            0.0,
            0.3,
            0.03,
            0.05,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = (
        "bleed valve schedules with hysteresis: Walsh and Fletcher, Gas Turbine Performance, ch. 5 and 8; assumed"
    )
    INPUTS = PAST
    SOUGHT = False
    TRIALS = tuple({"fraction": 0.05, "open_below": n, "band": b} for n, b in product((0.7, 0.8, 0.9), (0.05, 0.1)))

    def bled(self, at: Place, speed: Share) -> Share:
        share = at.remember(Scaled(Hysteresis()), ("fraction", "open_below", "band"))
        return lambda e: share(e, speed(e))

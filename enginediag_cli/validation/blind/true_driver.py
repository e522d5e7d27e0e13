"""What a concealed effect truly varies with, in the records of a trial: to judge the driver that was located."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.drivers import CONSTANT, SAME, SWITCH, true_drivers
from enginediag_cli.engine.term import Driver
from enginediag_cli.mismatch.fit.evidence import Evidence
from enginediag_cli.mismatch.fit.identified import drivers_of, inputs_of

UNDRIVEN = (CONSTANT, SWITCH)
"""What effects need not vary with."""


def driver_is_right(evidence: Evidence, health: Mapping[str, float], driver: Driver, named: str) -> bool | None:
    """Whether these records cannot tell the driver of that name from what `driver` stands for; None where it stands
    for nothing that varies here."""
    engine = evidence.engine
    inputs, theta = inputs_of(evidence), {n: v for n, v in health.items() if n in engine.parameters}
    found = drivers_of(evidence, theta)
    values = {d.name: d.values for d in found}
    moving = [d for d in found if d.driver == driver]
    true = [d.values for d in moving or true_drivers(engine, inputs, theta, driver)]
    if driver in UNDRIVEN or not true:
        return None
    if named not in values:
        return False
    return any(_correlation(values[named], t) > SAME for t in true)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """0 where one of them stands still."""
    good = np.isfinite(a) & np.isfinite(b)
    if not (good.any() and np.ptp(a[good]) and np.ptp(b[good])):
        return 0.0
    return abs(float(np.corrcoef(a[good], b[good])[0, 1]))

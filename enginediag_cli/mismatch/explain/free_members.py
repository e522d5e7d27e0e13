"""Unlisted physics as a member of a set: a free curve of one place along one driver, beside what is listed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from enginediag_cli.drivers import CONSTANT, TIME, polynomials
from enginediag_cli.engine.driver import DriverValues
from enginediag_cli.mismatch.explain.currency import FREE_FORM, Offer, Prices
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.freeform import DEGREE, Cell, machine_cells
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import FREE, Option
from enginediag_cli.mismatch.fit.trial_fit import Trial, remainder

CELLS = 12
"""Cells, most surprising first, whose promise is asked for."""


def unlisted(prices: Prices, drivers: Sequence[DriverValues]) -> Callable[[Trial], Sequence[Offer]]:
    """What proposes free curves for what a trial leaves; `drivers` are over the records of the evidence."""

    def propose(trial: Trial) -> list[Offer]:
        cells = [c for c in remainder(trial, (), drivers).cells if c.driver.driver != TIME and not c.score.absorbed]
        price = float(np.log(max(len(cells), 1) / FREE_FORM))
        carried = {e.label for e in trial.hypothesis.effects}
        ranked = sorted([*cells, *machine_cells(cells)], key=lambda c: -c.surprise)
        return [
            Offer(free_option(c), price, prices.promise(c, c.scales, price))
            for c in ranked[:CELLS]
            if c.location.through is None or c.location.through.label not in carried
        ]

    return propose


def free_option(cell: Cell) -> Option:
    """A cell as what may be added to the model: its curves, of unit mean square, as far as the place may vary."""
    place, driver = cell.location, cell.driver
    N = len(driver.values)
    columns = np.ones((N, 1)) if driver.driver == CONSTANT else polynomials(driver.values, DEGREE)
    curves = {f"{driver.name} {j + 1}": c for j, c in enumerate(columns.T)}
    sought = tuple(Discrepancy(p.parameter, key, p.scale) for p in place.parts for key in curves)
    through = (place.through,) if place.through is not None else ()
    label = f"{place.name} along {driver.name}"
    return Option(FREE, label, place.component, driver.driver, Hypothesis(through, sought, curves))

"""Unlisted physics as a member of a set: a free curve of one place along one driver, beside what is listed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.drivers import CONSTANT, TIME, polynomials
from enginediag_cli.engine.term import DriverValues
from enginediag_cli.mismatch.explain.currency import FREE_FORM, Offer, Prices
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.freeform import DEGREE, Cell, machine_cells
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import FREE, Option
from enginediag_cli.mismatch.fit.remainder import remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit

CELLS = 12
"""Cells, most surprising first, whose promise is asked for."""


class Unlisted:
    """Proposes free curves for what a trial leaves; `drivers` are over the records of the evidence."""

    def __init__(self, prices: Prices, drivers: Sequence[DriverValues]):
        self.prices, self.drivers = prices, drivers
        self._offered: dict[str, Cell] = {}

    def __call__(self, trial: HypothesisFit) -> list[Offer]:
        left = remainder(trial, (), self.drivers).cells
        cells = [c for c in left if c.driver.driver != TIME and not c.score.absorbed]
        price = float(np.log(max(len(cells), 1) / FREE_FORM))
        carried = {e.label for e in trial.hypothesis.effects}
        ranked = sorted([*cells, *machine_cells(cells)], key=lambda c: -c.surprise)
        chosen = [c for c in ranked[:CELLS] if c.location.through is None or c.location.through.label not in carried]
        offers = [Offer(free_option(c), price, self.prices.promise(c, c.scales, price)) for c in chosen]
        self._offered |= {o.option.label: c for o, c in zip(offers, chosen, strict=True)}
        return offers

    def over(self, option: Option, drivers: Sequence[DriverValues]) -> Option:
        """A free curve that was offered here, over other records, whose `drivers` are given."""
        cell = self._offered[option.label]
        same = next(d for d in drivers if d.name == cell.driver.name)
        return free_option(replace(cell, driver=same))


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

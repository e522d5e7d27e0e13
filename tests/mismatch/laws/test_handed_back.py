"""What a copy of the process says of laws comes back, whatever has moved in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from enginediag_cli.engine.filters import FilterClock
from enginediag_cli.mismatch.laws.at_place import in_both
from enginediag_cli.mismatch.laws.scan import KnownVariable, formulas
from enginediag_cli.parallel import ProcessCodec
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.law import formula_variables

TURBOFAN = Path(__file__).parents[3] / "configs" / "turbofan.yaml"


def test_formulas_of_a_variable_that_has_moved_come_back_with_their_forms_and_shapes() -> None:
    variables, r = formula_variables(load_engine(TURBOFAN).network), np.random.default_rng(0)
    clock = FilterClock(60.0 * np.arange(50), np.arange(50) == 0)
    known = [
        KnownVariable(variables[n], r.uniform(0.5, 1.0, 50), k, clock)
        for k, n in enumerate(("power", "burner_temperature"))
    ]
    moved = [known[0], replace(known[1], values=known[1].values * 1.1, tries={})]
    every = list(formulas(moved))
    assert moved[1].tries  # what was tried is kept with it
    handing = ProcessCodec(shared=in_both(known))
    back = handing.loads(handing.dumps({0: every}))[0]
    assert [f.form for f in back] == [f.form for f in every] and all(
        b.form is e.form for b, e in zip(back, every, strict=True)
    )
    assert back[0].of[0] is known[0]  # what has not moved is the very same
    assert all(np.array_equal(b.curve, e.curve) for b, e in zip(back, every, strict=True))

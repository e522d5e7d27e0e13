"""A column that switches an effect holds 0 or 1; what lies between is data that cannot be judged."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import TURBOFAN

from enginediag_cli.physics.engine_file import load_engine

CARRIED = """
physics:
  - {term: customer_bleed, at: hpc, coefficients: {fraction: 0.02}, switch: bleed_on}
"""


def test_a_switch_between_off_and_on_is_an_invalid_input_and_never_half_an_effect(tmp_path):
    path = tmp_path / "engine.yaml"
    path.write_text(TURBOFAN.read_text(encoding="utf-8") + CARRIED, encoding="utf-8")
    engine = load_engine(path)
    assert engine.switches == ("bleed_on",)
    U = {"altitude_m": 9000.0, "mach": 0.7, "dT_isa_K": 0.0}
    U |= {"bleed_on": np.array([0.0, 0.5, 1.0, -1.0, np.nan, 2.0])}
    U[engine.power_setting] = float(engine.power_from_fraction(0.8, U)[()])
    p = engine.predict(U, sensors=["T45_K"])
    assert p.ok.tolist() == [True, False, True, False, False, False]
    assert p.reason(1) == "column bleed_on is a switch and holds 0.5"
    assert np.isnan(p.y[[1, 3, 4, 5]]).all()
    assert p.y[2, 0] > p.y[0, 0]
    plain = {c: v for c, v in U.items() if c != "bleed_on"}
    assert engine.predict(plain, sensors=["T45_K"]).y[0, 0] == pytest.approx(p.y[0, 0], rel=1e-10)

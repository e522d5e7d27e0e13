"""An evaluation holds hundreds of arrays of one chunk: it must go when its chunk is done."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np

from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.physics.engine_file import load_engine

ROOT = Path(__file__).resolve().parents[2]


def test_no_evaluation_outlives_a_prediction_without_the_garbage_collector():
    engine = load_engine(ROOT / "configs" / "turbofan.yaml")
    points = {"altitude_m": np.full(50, 9000.0), "mach": np.full(50, 0.7), "dT_isa_K": np.zeros(50)}
    points["Wf_kg_s"] = np.linspace(0.5, 0.8, 50)
    gc.collect()
    gc.disable()
    try:
        assert engine.predict(points, wrt=engine.monitored).ok.all()
        assert not [x for x in gc.get_objects() if isinstance(x, Evaluation) and x.size > 1]  # the design point stays
    finally:
        gc.enable()

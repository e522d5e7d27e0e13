"""Offsets begin at what each recording differs by."""

from __future__ import annotations

import numpy as np
import pytest
from identification_toy import ToyEngine, fly

from enginediag_cli.identification.instruments import initial_offsets
from enginediag_cli.identification.normal_equations import predict
from enginediag_cli.identification.problem import IdentificationSettings, build_problem


def test_offsets_begin_at_the_medians_of_the_recordings_less_what_they_share():
    rng, engine = np.random.default_rng(0), ToyEngine()
    recordings = [fly(engine, rng, 200, str(b), bias={"T45_K": b}) for b in (-6.0, 0.0, 6.0)]
    problem = build_problem(engine, recordings, IdentificationSettings(recording_bias_sigma={"T45_K": 3.0}))
    zeros = np.zeros(5), np.zeros((3, 1))
    z = initial_offsets(problem, predict(problem, *zeros)[0])
    # the operating points of 200 records scatter, and the toy is not at nominal
    assert z[:, 0] == pytest.approx([-2.0, 0.0, 2.0], abs=0.5)
    assert z.mean(axis=0) == pytest.approx([0.0], abs=1e-12)

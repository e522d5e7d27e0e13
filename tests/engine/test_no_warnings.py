"""Wild inputs and parameters are flagged rows: no warning reaches the terminal, no exception leaves `predict`."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from engine_makers import CONFIGS

from enginediag_cli.physics.engine_file import load_engine

WILD = (0.0, -1.0, 1.0, 1e3, -1e4, 1e6, 1e-300, 1e308, -1e308, np.nan, np.inf, 8e4, 288.0, 101325.0)
SAMPLES = Path(__file__).parents[2] / "sample_data"


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda p: p.stem)
@pytest.mark.parametrize("n", [1, 30, 120])
def test_wild_inputs_are_flagged_without_a_warning(path, n):
    engine = load_engine(path)
    rng = np.random.default_rng(1)
    usual = {c: np.full(n, np.mean(engine.envelope.get(c, 0.0))) for c in engine.inputs}
    wild = {c: np.where(rng.random(n) < 0.2, rng.choice(WILD, n), x) for c, x in usual.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        engine.power_from_fraction(0.5, wild)
        for inputs in (wild, {c: rng.choice(WILD, n) for c in engine.inputs}):
            p = engine.predict(inputs, wrt=engine.monitored[:2])
            assert np.isfinite(p.y[p.ok]).all()
            assert all(p.reason(k) for k in np.flatnonzero(p.status))
        engine.predict(usual, {engine.monitored[0]: rng.choice([1.0, 1e300, -5.0, 0.0, 1e-3], n)})


@pytest.mark.slow
def test_commands_on_hard_recordings_raise_no_runtime_warning(tmp_path):
    lines = (SAMPLES / "one_flight.csv").read_text(encoding="utf-8").splitlines()
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    columns = lines[head].split(",")
    rows = [line.split(",") for line in lines[head + 1 : head + 201]]
    for k, cell in enumerate(("1e308", "-1e308", "1e-300", "0", "-40000", "nan", "inf")):
        for column in (c for c in columns if c not in ("flight", "phase", "time_s", "status")):
            rows[10 + 7 * k][columns.index(column)] = cell
            rows[90 + (13 * k + columns.index(column)) % 100][columns.index(column)] = cell
    path = tmp_path / "hard.csv"
    path.write_text("\n".join([lines[head], *map(",".join, rows)]) + "\n", encoding="utf-8")
    nominal = tmp_path / "nominal.yaml"
    run = [sys.executable, "-W", "error::RuntimeWarning", "-m", "enginediag_cli"]
    healthy = SAMPLES / "healthy_snapshots.csv"
    for arguments in (
        ["identify", "turbofan.yaml", healthy, "-o", nominal],
        ["check", path],
        ["detect", "-n", nominal, path, "--window", "50"],
        ["residual", "-n", nominal, path],
        ["isolate", "-n", nominal, path],
    ):
        done = subprocess.run([*run, *map(str, arguments)], capture_output=True, text=True, timeout=120, cwd=tmp_path)
        assert done.returncode in (0, 3), (arguments, done.stderr[-2000:])
        assert "RuntimeWarning" not in done.stderr and "Traceback" not in done.stderr, arguments

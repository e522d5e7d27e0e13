"""What the power plant's base-load engine misses at part load: python tests/real_runs/part_load.py NOMINAL RECORDING

NOMINAL: identified at base load; RECORDING: a year of the UCI power plant. One line: medians of measured against
calculated over the steady hours with TIT below 1097 °C.
"""

from __future__ import annotations

import sys

import numpy as np
from ground_recordings import CONFIGS

from enginediag_cli.identification.nominal_file import read_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.recorder_file import load_recorder

PART_BELOW_K = 1370.15


def main() -> None:
    [mapped] = load_recorder(CONFIGS / "recorders" / "uci_gas_turbine.yaml").read(sys.argv[2])
    part = mapped.recording.select(mapped.recording["T4_K"] < PART_BELOW_K)
    engine = load_engine(CONFIGS / "power_plant.yaml")
    inputs = {c: part[c] for c in (*engine.inputs, *engine.optional_inputs) if c in part.columns}
    nominal = read_nominal(sys.argv[1])
    p = nominal.error_model.wrap(engine).predict(inputs, nominal.theta0, sensors=["P3_Pa", "T5_K", "power_W"])
    CDP, TAT, TEY = (part[c] for c in ("P3_Pa", "T5_K", "power_W"))
    print(
        f"{len(CDP)} steady hours below 1097 °C, measured against calculated (medians): "
        f"CDP {100 * np.nanmedian(CDP / p.y[:, 0] - 1):+.0f} %, TAT {np.nanmedian(TAT - p.y[:, 1]):+.0f} K, "
        f"power {100 * np.nanmedian(TEY / p.y[:, 2] - 1):+.0f} %"
    )


if __name__ == "__main__":
    main()

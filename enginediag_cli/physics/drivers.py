"""The words for what an effect varies with; `enginediag_cli.drivers` computes their values."""

from __future__ import annotations

DRIVERS: dict[str, str] = {
    "constant": "nothing: the same in every record",
    "mach": "flight Mach number",
    "ambient_pressure": "ambient pressure (altitude)",
    "inlet_temperature": "total temperature at the engine's inlet",
    "corrected_speed": "corrected shaft speed",
    "shaft_speed": "mechanical shaft speed",
    "power": "corrected power: burner temperature ratio T4/T2",
    "reynolds_index": "Reynolds number index, at the inlet or the turbines",
    "humidity": "water in the air",
    "hours": "time in service",
    "switch": "a commanded state that may be on or off",
    "nozzle_pressure_ratio": "pressure ratio of a nozzle",
    "bypass_ratio": "bypass ratio",
    "compressor_pressure": "pressure behind the last compressor",
}

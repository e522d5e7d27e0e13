"""Headers of public formats, re-created: what each column is. The values are made here, at one operating point of a
machine of that kind, with some per cent of variation.

A row is `column|target|unit`, with `-` for a column of which the program has no use, `clock` for one of the clock and
`text` for what names a flight, an engine or a phase. A unit in brackets is not stated by the name.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.units import find_unit

RECORDS = 40
K = np.arange(RECORDS)

AIRLINER = {
    "altitude_m": 10668.0,
    "mach": 0.78,
    "cas_m_s": 135.0,
    "tas_m_s": 231.0,
    "ambient_temperature_K": 219.5,
    "TAT_K": 246.2,
    "ambient_pressure_Pa": 23842.0,
    "N1_rpm": 4700.0,
    "N2_rpm": 13600.0,
    "N3_rpm": 9800.0,
    "EGT_K": 850.0,
    "ITT_K": 1010.0,
    "Wf_kg_s": 0.33,
    "T1_K": 246.2,
    "T2_K": 246.2,
    "P2_Pa": 35600.0,
    "T13_K": 290.0,
    "P13_Pa": 57000.0,
    "P15_Pa": 56000.0,
    "T21_K": 288.0,
    "P21_Pa": 57000.0,
    "T24_K": 325.0,
    "P24_Pa": 85000.0,
    "T25_K": 325.0,
    "P25_Pa": 84000.0,
    "T3_K": 690.0,
    "P3_Pa": 1.02e6,
    "Ps3_Pa": 0.97e6,
    "T4_K": 1480.0,
    "P4_Pa": 0.97e6,
    "T41_K": 1440.0,
    "T45_K": 1050.0,
    "P45_Pa": 2.3e5,
    "T48_K": 1050.0,
    "P49_Pa": 2.2e5,
    "T49_K": 1010.0,
    "T5_K": 790.0,
    "P5_Pa": 52000.0,
    "W2_kg_s": 150.0,
    "W25_kg_s": 25.0,
    "W31_kg_s": 2.0,
    "W32_kg_s": 1.2,
    "Fn_N": 25000.0,
    "Fg_N": 61000.0,
    "EPR": 1.45,
    "BPR": 5.1,
    "fuel_ratio_kg_s_Pa": 0.33 / 0.97e6,
}
TURBOPROP = {
    **AIRLINER,
    "altitude_m": 5486.0,
    "mach": 0.35,
    "cas_m_s": 86.0,
    "tas_m_s": 113.0,
    "ambient_temperature_K": 257.0,
    "TAT_K": 263.3,
    "ambient_pressure_Pa": 50600.0,
    "N1_rpm": 36500.0,
    "N2_rpm": 1700.0,
    "ITT_K": 970.0,
    "EGT_K": 970.0,
    "T45_K": 970.0,
    "Wf_kg_s": 0.05,
    "torque_Nm": 1900.0,
    "power_W": 4.5e5,
    "T3_K": 540.0,
    "P3_Pa": 5.1e5,
}
PLANT = {
    **AIRLINER,
    "ambient_temperature_K": 291.0,
    "ambient_pressure_Pa": 101000.0,
    "relative_humidity": 0.6,
    "T2_K": 291.5,
    "P2_Pa": 100200.0,
    "T3_K": 655.0,
    "P3_Pa": 1.25e6,
    "T4_K": 1420.0,
    "T5_K": 830.0,
    "EGT_K": 830.0,
    "P5_Pa": 104000.0,
    "power_W": 8.2e7,
    "Wf_kg_s": 5.6,
    "N1_rpm": 3600.0,
    "N2_rpm": 3600.0,
    "dP_inlet_Pa": 800.0,
    "dP_exhaust_Pa": 3000.0,
    "T45_K": 1060.0,
    "P45_Pa": 4.1e5,
    "torque_Nm": 6.0e4,
}
BENCH = {
    **PLANT,
    "N1_rpm": 96000.0,
    "N2_rpm": 33000.0,
    "T3_K": 440.0,
    "P3_Pa": 3.4e5,
    "Ps3_Pa": 3.2e5,
    "T4_K": 1090.0,
    "P4_Pa": 3.1e5,
    "T5_K": 930.0,
    "EGT_K": 930.0,
    "P5_Pa": 1.5e5,
    "Wf_kg_s": 0.0082,
    "Fn_N": 190.0,
    "W2_kg_s": 0.42,
    "power_W": 28000.0,
    "torque_Nm": 180.0,
}
FULL_SCALE = {"N1_rpm": 1.1, "N2_rpm": 1.08, "N3_rpm": 1.05, "torque_Nm": 1.3, "power_W": 1.2}
"""100 % of a column, over its value at the operating point."""
NOT_IN_UNITS = {
    "krpm": ("rpm", 1000.0, False),
    "psig": ("psi", 1.0, True),
    "barg": ("bar", 1.0, True),
    "kPag": ("kPa", 1.0, True),
    "mmH2O": ("Pa", 9.80665, False),
    "mmHg": ("Pa", 133.322, False),
    "kg_cm2": ("Pa", 98066.5, False),
    "kg_cm2g": ("Pa", 98066.5, True),
    "klb_h": ("lb_h", 1000.0, False),
    "kgf": ("N", 9.80665, False),
    "ms": ("s", 1e-3, False),
}
"""Units of headers → unit of the program, factor, whether gauge."""


@dataclass(frozen=True)
class Expected:
    column: str
    target: str
    unit: str
    stated: bool


@dataclass(frozen=True)
class HeaderCase:
    """A header: the machine's operating point, the rows, the rows of units or other lines above and below the names."""

    name: str
    point: dict[str, float]
    rows: str
    delimiter: str = ","
    unit_row: str = ""
    clock: str = "iso"

    @property
    def expected(self) -> list[Expected]:
        found = []
        for line in self.rows.strip().splitlines():
            column, target, unit = (
                part.strip() for part in (line.rsplit("|", 2) if line.count("|") > 1 else (line, "", ""))
            )
            bare = unit.strip("()")
            found.append(Expected(column, target, bare, bare == unit))
        return found

    def cells(self, e: Expected, number: int) -> list[str]:
        """One column's cells."""
        if e.target == "clock":
            second = [f"{k // 60:02d}:{k % 60:02d}" for k in K]
            forms = {
                "iso": [f"2024-03-14T10:{s}" for s in second],
                "date": ["2024-03-14" for _ in second],
                "time": [f"10:{s}" for s in second],
                "seconds": [str(k) for k in K],
                "epoch": [str(1710410400 + k) for k in K],
                "acars": [f"{1 + k // 2:02d}-Mar-24 {8 + 4 * (k % 2):02d}:00" for k in K],
                "us": [f"03/14/2024 10:{s}" for s in second],
                "eu": [f"14.03.2024 10:{s}" for s in second],
            }
            return forms[e.unit or self.clock]
        if e.target == "text":
            return [e.unit] * RECORDS if e.unit and not e.unit.isdigit() else [str(1 + k // 10) for k in K]
        wave = 1.0 + 0.01 * np.sin(0.3 * K + number)
        if e.target == "-" and e.unit == "cycles":
            return [str(1 + k % 10) for k in K]
        if e.target == "-":
            return [f"{x:.4g}" for x in 37.0 * wave]
        si = self.point[e.target] * wave
        return [f"{x:.6g}" for x in self.reading(e, si)]

    def reading(self, e: Expected, si: np.ndarray) -> np.ndarray:
        """Readings in the column's unit."""
        unit, scale, gauge = NOT_IN_UNITS.get(e.unit, (e.unit or "1", 1.0, False))
        known = find_unit(unit)
        if unit == "pct" and e.target in FULL_SCALE:
            return 100.0 * si / (FULL_SCALE[e.target] * self.point[e.target])
        if known.dimension == "volume flow":
            si = si / 800.0
        if gauge:
            si = si - self.point["ambient_pressure_Pa"]
        return (si - known.offset) / known.factor / scale

    @property
    def text(self) -> str:
        """The file."""
        expected = self.expected
        columns = [self.cells(e, k) for k, e in enumerate(expected)]
        head = self.delimiter.join(e.column for e in expected)
        body = [self.delimiter.join(c[k] for c in columns) for k in range(RECORDS)]
        units = [self.delimiter.join(self.unit_row.split("|"))] if self.unit_row else []
        return "\n".join([head, *units, *body]) + "\n"

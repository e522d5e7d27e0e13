"""Public formats whose names mean something else than elsewhere, or nothing by themselves: `TAT` of a power plant is
the temperature after the turbine, `s11` of C-MAPSS a fuel flow per pressure. A scheme is taken when most of its names
are there."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

LEAST = 0.6
"""Share of a scheme's names that must be in a header: files are often published with some columns left out."""


@dataclass(frozen=True)
class Documented:
    """What the documentation of a format says of a column: target (empty: of no use here), unit, and what to mind."""

    target: str
    unit: str = ""
    doubt: str = ""
    text: str = ""
    """Target text column, for what names a flight or an engine."""


@dataclass(frozen=True)
class NamingScheme:
    """name: of the format; columns: names in small letters and digits only → meaning; spelt: how a name may be spelt
    otherwise, as (pattern, replacement); constants: what the format leaves out because it is always so."""

    name: str
    columns: Mapping[str, Documented]
    spelt: tuple[tuple[str, str], ...] = ()
    constants: Mapping[str, float] | None = None

    def find(self, column: str) -> Documented | None:
        """The meaning of a column's name, its unit at the end left out."""
        bare = re.sub(r"[^a-z0-9]", "", column.casefold())
        for pattern, form in self.spelt:
            bare = re.sub(pattern, form, bare)
        return self.columns.get(bare)


def _numbered(prefix: str, entries: Sequence[Documented]) -> dict[str, Documented]:
    return {f"{prefix}{k + 1}": entry for k, entry in enumerate(entries)}


_NOT_USED = Documented("")
_PHI = "the documentation says phi for this column and Ps30 for the other; by their values they are the other way round"

CMAPSS = NamingScheme(
    "C-MAPSS (NASA turbofan degradation data)",
    {
        **{
            word: Documented("", text="engine")
            for word in ("unit", "unitnumber", "unitnr", "unitid", "engine", "id", "c1")
        },
        **{word: Documented("", text="flight") for word in ("cycle", "cycles", "time", "timecycles", "timeincycles")},
        **_numbered(
            "setting",
            (
                Documented("altitude_m", "kft"),
                Documented("mach", "1"),
                _NOT_USED,
            ),
        ),
        **_numbered(
            "s",
            (
                Documented("T2_K", "degR"),
                Documented("T24_K", "degR"),
                Documented("T3_K", "degR"),
                Documented("T5_K", "degR"),
                Documented("P2_Pa", "psi"),
                Documented("P15_Pa", "psi"),
                Documented("P3_Pa", "psi"),
                Documented("N1_rpm", "rpm"),
                Documented("N2_rpm", "rpm"),
                Documented("EPR", "1"),
                Documented("fuel_ratio_kg_s_Pa", "pph_psi", _PHI),
                Documented("Ps3_Pa", "psi", _PHI),
                _NOT_USED,
                _NOT_USED,
                Documented("BPR", "1"),
                _NOT_USED,
                _NOT_USED,
                _NOT_USED,
                _NOT_USED,
                Documented("W31_kg_s", "lb_s"),
                Documented("W32_kg_s", "lb_s"),
            ),
        ),
    },
    (
        (r"^(sensormeasurement|sensormeasure|sensor|sm|sens)0*(\d+)$", r"s\2"),
        (r"^(operationalsetting|opsetting|opset|os|op|setting)0*(\d)$", r"setting\2"),
    ),
)
CMAPSS_ORDER = ("unit", "cycle", "setting1", "setting2", "setting3", *(f"s{k}" for k in range(1, 22)))
"""The columns of the text files as they are distributed, without a header (Saxena and Goebel 2008, readme)."""

_N_CMAPSS_UNITS = {
    **{
        f"t{n}": (f"T{t}_K", "degR")
        for n, t in (("2", "2"), ("24", "24"), ("30", "3"), ("48", "48"), ("50", "5"), ("40", "4"))
    },
    **{
        f"p{n}": (f"P{t}_Pa", "psi")
        for n, t in (("2", "2"), ("15", "15"), ("21", "21"), ("24", "24"), ("40", "4"), ("45", "45"), ("50", "5"))
    },
    "ps30": ("Ps3_Pa", "psi"),
    "nf": ("N1_rpm", "rpm"),
    "nc": ("N2_rpm", "rpm"),
    "wf": ("Wf_kg_s", "lb_s"),
    "alt": ("altitude_m", "ft"),
    "mach": ("mach", "1"),
}
N_CMAPSS = NamingScheme(
    "N-CMAPSS (NASA turbofan data set 2)",
    {
        **{name: Documented(*pair) for name, pair in _N_CMAPSS_UNITS.items()},
        **dict.fromkeys(("tra", "fc", "hs"), _NOT_USED),
        "unit": Documented("", text="engine"),
        "cycle": Documented("", text="flight"),
    },
)

UCI_POWER_PLANT = NamingScheme(
    "UCI gas turbine CO and NOx data",
    {
        "at": Documented("ambient_temperature_K", "degC"),
        "ap": Documented("ambient_pressure_Pa", "mbar"),
        "ah": Documented("relative_humidity", "pct"),
        "afdp": Documented("dP_inlet_Pa", "mbar"),
        "gtep": Documented("dP_exhaust_Pa", "mbar"),
        "tit": Documented("T4_K", "degC"),
        "tat": Documented("T5_K", "degC"),
        "cdp": Documented("P3_Pa", "bar", "documented in mbar, with values in bar"),
        "tey": Documented("power_W", "MW"),
    },
)
NAVAL = NamingScheme(
    "UCI condition-based maintenance of naval propulsion plants",
    {
        "lp": _NOT_USED,
        "v": _NOT_USED,
        "gtt": Documented("torque_Nm", "kNm", "documented in kN m, and published with values in kN m or in N m"),
        "gtn": Documented("N2_rpm", "rpm"),
        "ggn": Documented("N1_rpm", "rpm"),
        "ts": _NOT_USED,
        "tp": _NOT_USED,
        "t48": Documented("T45_K"),
        "t1": Documented("T2_K"),
        "t2": Documented("T3_K"),
        "p48": Documented("P45_Pa", "bar"),
        "p1": Documented("P2_Pa", "bar"),
        "p2": Documented("P3_Pa", "bar"),
        "pexh": Documented("P5_Pa", "bar"),
        "tic": _NOT_USED,
        "mf": Documented("Wf_kg_s", "kg_s"),
    },
    constants={"altitude_m": 0.0, "mach": 0.0},
)
SCHEMES = (CMAPSS, N_CMAPSS, UCI_POWER_PLANT, NAVAL)


def scheme_of(names: Sequence[str]) -> NamingScheme | None:
    """The scheme whose names the columns' names (without units) mostly are, or None."""
    best, share = None, LEAST
    for scheme in SCHEMES:
        found = {id(entry): entry for name in names if (entry := scheme.find(name)) is not None}
        distinct = {name for name in names if scheme.find(name) is not None}
        meanings = {entry.target or entry.text for entry in scheme.columns.values()}
        here = {entry.target or entry.text for entry in found.values()}
        value = min(len(distinct) / max(len(meanings), 1), len(here) / len(meanings))
        if value >= share:
            best, share = scheme, value
    return best

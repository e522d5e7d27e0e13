"""The steps of the demonstration as the command lines that a user would type."""

from __future__ import annotations

from dataclasses import dataclass

ENGINE = "turbofan.yaml"
HEALTHY, NOMINAL = "healthy.csv", "nominal.yaml"
HEALTHY_FLIGHTS = 3
"""Enough to identify noise and its correlation, few enough that the story takes less than a minute."""


@dataclass(frozen=True)
class Case:
    """Flights of one engine: `file` is the stem of its files, `fault` a shipped fault file or "" for none."""

    file: str
    title: str
    flights: int
    fault: str = ""

    @property
    def recording(self) -> str:
        return f"{self.file}.csv"

    @property
    def truth(self) -> str:
        return f"{self.file}_truth.csv"

    @property
    def detected(self) -> str:
        return f"{self.file}_detected.json"

    @property
    def isolated(self) -> str:
        return f"{self.file}_isolated.json"


CASES = (
    Case("fresh", "an engine in which nothing is wrong", 2),
    Case("fouled", "an engine whose high-pressure compressor fouls", 6, "faults/hpc_fouling.yaml"),
    Case("misread", "a healthy engine whose T3 thermocouple reads high", 4, "faults/sensor_T3_bias.yaml"),
)

INGREDIENTS = (ENGINE, *(case.fault for case in CASES if case.fault))
"""Shipped files that the command lines name."""


def record_healthy(seed: int) -> list[str]:
    return ["simulate", ENGINE, "--flights", str(HEALTHY_FLIGHTS), "--seed", str(seed), "-o", HEALTHY]


def identify() -> list[str]:
    return ["identify", ENGINE, HEALTHY, "--no-cross-validation", "-o", NOMINAL]


def fly(case: Case, seed: int) -> list[str]:
    fault = ["--fault", case.fault] if case.fault else []
    return [
        "simulate",
        ENGINE,
        *fault,
        "--flights",
        str(case.flights),
        "--seed",
        str(seed),
        "--truth",
        case.truth,
        "-o",
        case.recording,
    ]


def detect(case: Case) -> list[str]:
    return ["detect", "-n", NOMINAL, case.recording, "-o", case.detected]


def isolate(case: Case) -> list[str]:
    return ["isolate", "-n", NOMINAL, case.recording, "-o", case.isolated]


def report() -> list[str]:
    """The engine that wears, as a page."""
    worn = next(case for case in CASES if case.fault)
    return ["report", "-n", NOMINAL, worn.recording, "-o", PAGE]


PAGE = "report.html"

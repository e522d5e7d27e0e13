"""An effect that the model lacks and no column shows, as the command lines that a user would type to find it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

ENGINE, AIRLINER = "turbofan.yaml", "flights/airliner.yaml"
INGREDIENTS = (ENGINE, AIRLINER)
"""Shipped files that the command lines name."""

TERM, SITE, COEFFICIENT, SIZE = "reynolds_efficiency", "hpc", "exponent", 0.15
"""What the engine that flies has and the engine file given to the search has not; the size lies within the published
range of the exponent (0.06 to 0.20, NASA TN D-6640)."""

TRUTH, FLIGHTS, RECORDED, UNSEEN = "truth.yaml", "flights.yaml", "recorded.csv", "unseen.csv"
LOCATED, MAP = "located.json", "locate.svg"
EXPLAINED = "explained.json"
REFINED, REPORT, BEFORE_AFTER = "refined.yaml", "refined.json", "refine.svg"
PAGE = "report.html"
FITTED_FLIGHTS, UNSEEN_FLIGHTS = 5, 10
"""Few enough that the story takes a minute; the unseen ones suffice to be compared flight by flight (five at least)."""
WINDOW = 30
"""Records of a window for `detect` and `refine`: the usual length of a steady stretch, judgement."""

EVERY_10_S, EVERY_MINUTE = "record_interval_s: 10", "record_interval_s: 60"
CARRIED = f"physics:\n  - {{term: {TERM}, at: {SITE}, coefficients: {{{COEFFICIENT}: {SIZE:g}}}}}\n"


def preparations() -> list[str]:
    """What `prepare` does, as shell commands."""
    carried = CARRIED.replace("\n", "\\n")
    return [
        f"sed 's/{EVERY_10_S}/{EVERY_MINUTE}/' {AIRLINER} > {FLIGHTS}",
        f"(cat {ENGINE}; printf '\\n{carried}') > {TRUTH}",
    ]


def prepare() -> None:
    """Write the flights to be flown and the engine that carries the effect, from the shipped files.

    Raises ValueError where the shipped flights are not recorded as often as is assumed here.
    """
    flights = Path(AIRLINER).read_text(encoding="utf-8")
    if EVERY_10_S not in flights:
        raise ValueError(f"{AIRLINER} has no line `{EVERY_10_S}`")
    _write(FLIGHTS, flights.replace(EVERY_10_S, EVERY_MINUTE))
    _write(TRUTH, f"{Path(ENGINE).read_text(encoding='utf-8')}\n{CARRIED}")


def _write(path: str, text: str) -> None:
    with open(path, "w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)


def fly(recording: str, flights: int, seed: int) -> list[str]:
    return [
        "simulate",
        TRUTH,
        "--flight",
        FLIGHTS,
        "--flights",
        str(flights),
        "--seed",
        str(seed),
        "--no-header",
        "-o",
        recording,
    ]


def locate() -> list[str]:
    return ["locate", ENGINE, RECORDED, "--picture", MAP, "-o", LOCATED]


def explain() -> list[str]:
    return ["explain", ENGINE, RECORDED, "--no-advice", "-o", EXPLAINED]


def refine(effects: Sequence[str]) -> list[str]:
    """With the effects that `explain` named."""
    named = [word for label in effects for word in ("--term", label)]
    return [
        "refine",
        ENGINE,
        RECORDED,
        *named,
        "--test",
        UNSEEN,
        "--window",
        str(WINDOW),
        "-o",
        REFINED,
        "--report",
        REPORT,
        "--picture",
        BEFORE_AFTER,
    ]


def nominal_of(engine: str) -> str:
    return f"{Path(engine).stem}_nominal.yaml"


def detected_by(engine: str) -> str:
    return f"{Path(engine).stem}_detected.json"


def identify(engine: str) -> list[str]:
    return ["identify", engine, RECORDED, "--no-cross-validation", "-o", nominal_of(engine)]


def detect(engine: str) -> list[str]:
    return ["detect", "-n", nominal_of(engine), UNSEEN, "--window", str(WINDOW), "-o", detected_by(engine)]


def report() -> list[str]:
    """All answers as one page."""
    return ["report", LOCATED, EXPLAINED, REPORT, "-o", PAGE]


def named_effects(explained: Path) -> list[str]:
    """Effects of the first explanation in a JSON file of `explain`; none where it named none, or a fault."""
    first = json.loads(explained.read_text(encoding="utf-8"))["explanations"][:1]
    if not first or set(first[0]["kinds"]) != {"effect"}:
        return []
    return str(first[0]["name"]).split(" + ")

"""Files as the commands write them, small and made by hand: one engine, one answer of explain, one fleet."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

HEAD = "# enginediag: 0.4.0\n# command: {command}\n# seed: 3\n"
WINDOW = "source,flight,engine,first_line,last_line,start_s,end_s,records,outside,incomplete,failed,sensors,sensors_of"
NAMES = ("hpc.efficiency", "hpc.flow_capacity", "fan.efficiency", "sensor.T3.bias")
ONSET, FLIGHTS = 4, 8


def window(flight: int, engine: str = "") -> str:
    first = 10 + 100 * flight
    return f"flights.csv,{flight},{engine},{first},{first + 99},{3600.0 * flight},{3600.0 * flight + 990},100,2,0,0,9,9"


def share(flight: int) -> float:
    return max(0.0, (flight - ONSET + 1) / (FLIGHTS - ONSET + 1))


def detected(folder: Path, engine: str = "") -> Path:
    rows = [HEAD.format(command="detect") + WINDOW + ",reason,judged,statistic,dof,threshold,p_value,alarm,fit,verdict"]
    for k in range(1, FLIGHTS + 1):
        fault = k >= ONSET
        verdict = "fault" if fault else "healthy"
        rows.append(
            f"{window(k, engine)},,98,{8.0 + 900 * share(k)},11,24.8,{0.0 if fault else 0.6},{fault},1.01,{verdict}"
        )
    return _written(folder / "d.csv", rows)


def isolated(folder: Path, engine: str = "") -> Path:
    """As JSON, whose rows hold lists."""
    rows = []
    for k in range(1, FLIGHTS + 1):
        cells: dict[str, Any] = dict(zip(WINDOW.split(","), window(k, engine).split(","), strict=True))
        empty = {"members": None, "class": None, "would_tell": None, "note": "", "rivals_left_out": 0, "reason": ""}
        shared = {**cells, **empty, "p_value": 0.5, "fit_before": 1.3, "fit": 1.0, "explained": 0.9}
        if k < ONSET:
            one = {"verdict": "healthy", "isolated": [], "probability": 0.95, "parameter": None, "inclusion": None}
            rows.append({**shared, **one, "change": None, "lower": None, "upper": None, "unit": None, "rivals": []})
            continue
        for name, size in (("hpc.efficiency", -0.008), ("hpc.flow_capacity", -0.016)):
            change = size * share(k)
            told = {"verdict": "fault", "isolated": list(NAMES[:2]), "probability": 0.9, "inclusion": 0.99}
            sizes = {"parameter": name, "change": change, "lower": change - 0.001, "upper": change + 0.001, "unit": "1"}
            rivals = ["fan.efficiency & hpc.efficiency (0.03)", "nothing (0.01)"]
            rows.append({**shared, **told, **sizes, "rivals": rivals})
    return _json(folder / "i.json", rows)


FLIGHT_COLUMNS = "engine,source,flight,number,records,parameter,change,low,high,unit,level,level_low,level_high,time_s"
DATE_S = 1_767_225_600.0
"""Midnight of 1 January 2026."""


def followed(folder: Path, engine: str = "") -> Path:
    """What `trend --what flights` writes."""
    noise = np.random.default_rng(5)
    rows = [HEAD.format(command="trend") + FLIGHT_COLUMNS]
    for k in range(1, FLIGHTS + 1):
        for name, size in zip(NAMES, (-0.008, -0.016, 0.0, 0.0), strict=True):
            change, half = size * share(k) + 0.0005 * noise.standard_normal(), 0.001
            place = f"{engine},flights.csv,{k},{k},98,{name}"
            level = size * share(k)
            together = f"{level},{level - half * share(k)},{level + half * share(k)},{DATE_S + 86400.0 * k}"
            rows.append(f"{place},{change},{change - half},{change + half},{'K' if 'T3' in name else '1'},{together}")
    return _written(folder / "f.csv", rows)


def trend(folder: Path, engine: str = "") -> Path:
    columns = (
        "engine,flights,parameter,verdict,fit_before,fit,component,kind,probability,onset,onset_low,onset_high,"
        "onset_flight,onset_source,onset_line,onset_s,change,change_low,change_high,rate_per_flight,rate_low,rate_high,"
        "unit,rivals"
    )
    rows = [HEAD.format(command="trend") + columns]
    for name, size in (("hpc.efficiency", -0.008), ("hpc.flow_capacity", -0.016)):
        begun = f"hpc,deterioration,0.99,{ONSET},{ONSET},{ONSET + 1},{ONSET},flights.csv,410,14400.0"
        sizes = f"{size},{size - 0.001},{size + 0.001},-0.002,-0.003,-0.001"
        rows.append(f"{engine},{FLIGHTS},{name},changed,40,0.5,{begun},{sizes},1,")
    rows.append(f"{engine},{FLIGHTS},fan.efficiency,changed,40,0.5,fan,steady,0.01,{',' * 12},1,")
    return _written(folder / "t.csv", rows)


def records(folder: Path, count: int = 400, sensors: Sequence[str] = ("T3_K", "N2_rpm", "P3_Pa")) -> Path:
    noise = np.random.default_rng(7)
    head = "".join(f",{s}:residual,{s}:sigmas" for s in sensors)
    rows = [HEAD.format(command="residual") + f"source,line,flight,time_s{head},state"]
    for k in range(count):
        values = noise.standard_normal(len(sensors)) + 2.0 * k / count
        cells = "".join(f",{1.5 * v:.6g},{v:.6g}" for v in values)
        rows.append(f"flights.csv,{k + 10},{1 + 8 * k // count},{10.0 * k}{cells},ok")
    return _written(folder / "r.csv", rows)


def explained(folder: Path) -> Path:
    places = [
        {"location": "hpc.efficiency", "component": "hpc", "driver": d, "surprise": s, "statistic": 2 * s, "dof": 2}
        for d, s in (("reynolds_index", 496.2), ("ambient_pressure", 288.2))
    ]
    band = {"variable": "burner_temperature", "values": [0.7, 0.8, 0.9], "change": [-0.006, 0.0, 0.01], "unit": "1"}
    coefficient = {"name": "reynolds.hpc.exponent", "unit": "1", "value": 0.154, "standard_error": 0.0044}
    return _json(
        folder / "e.json",
        {
            "status": "named",
            "reason": "",
            "sentences": ["Missing: Reynolds number, compressor efficiency at HPC.", "  exponent = 0.154."],
            "explanations": [
                {
                    "name": "reynolds_efficiency@hpc",
                    "in_words": "Reynolds number, compressor efficiency at HPC",
                    "probability": 0.998,
                    "gain": 1024.9,
                    "coefficients": [{**coefficient, "low": 0.146, "high": 0.163}],
                }
            ],
            "rejected": {"heat_soak@booster": "χ² is 871.7 worse"},
            "places": places,
            "gates": [8.4, 9.9],
            "law": {
                "places": [{"location": "cooling.hpt_vanes.fraction", "probability": 0.7}],
                "band": {**band, "standard_error": [0.001, 0.0005, 0.002]},
            },
            "provenance": ["enginediag: 0.4.0", "command: explain", "seed: 0"],
        },
    )


def refined(folder: Path) -> Path:
    rows = [
        {"what": what, "of": of, "unit": unit, "before": before, "after": after, "n": 1218}
        for what, of, unit, before, after in (
            ("rms", "T3_K", "K", 1.72, 1.555),
            ("chi2 per reading", "T3_K", "1", 1.3147, 1.0749),
            ("chi2 per reading", "all", "1", 1.123, 1.011),
        )
    ]
    return _json(
        folder / "x.json",
        {
            "verdict": "accepted",
            "refused": None,
            "still_missing": None,
            "sentences": ["Unseen flights: χ² per reading 1.123 before, 1.011 after."],
            "effects": [{"term": "reynolds_efficiency", "at": "hpc", "coefficients": {"exponent": 0.148}}],
            "criteria": [],
            "flights": [{"flight": f"unseen.csv flight {k}", "gain": g} for k, g in ((1, 56.8), (2, -3.1))],
            "chi2_per_reading": {"before": 1.123, "after": 1.011, "of": 10953},
            "rows": rows,
            "provenance": ["enginediag: 0.4.0", "command: refine"],
        },
    )


def fleet(folder: Path, engines: int = 30, flights: int = 60) -> Path:
    noise = np.random.default_rng(11)

    def estimate(value: float, half: float) -> dict[str, float]:
        return {"value": value, "low": value - half, "high": value + half}

    found = []
    for k in range(engines):
        size = 30.0 * (1 - k / engines)
        changed = k < engines // 3
        health = [
            {
                "parameter": name,
                "component": name.split(".")[0],
                "words": words,
                "unit": "1",
                "change": estimate(
                    -0.001 * size * (j == 0 and changed) + 0.0004 * noise.standard_normal() + 0.003 * (j == 2), 0.001
                ),
                "kind": "deterioration" if changed and j == 0 else "steady",
                "probability": 0.97 if changed and j == 0 else 0.02,
                "onset": 20 if changed and j == 0 else 0,
                "onset_flight": "F20" if changed and j == 0 else "",
            }
            for j, (name, words) in enumerate(
                (
                    ("hpc.efficiency", "HPC isentropic efficiency"),
                    ("fan.efficiency", "fan efficiency"),
                    ("lpt.efficiency", "LPT efficiency"),
                )
            )
        ]
        used = [size * max(0, n - 20) / flights + noise.standard_normal() for n in range(1, flights + 1)]
        by_flight = [
            {
                "number": n,
                "flight": f"F{n}",
                "records": 20,
                "verdict": "changed" if changed and n > 25 else "healthy",
                "consumed_K": used[n - 1],
                "consumed_error_K": 1.0,
            }
            for n in range(1, flights + 1)
        ]
        found.append(
            {
                "rank": k + 1,
                "serial": f"ESN-{1000 + k}",
                "build": "A",
                "flights": flights,
                "records": 20 * flights,
                "verdict": "changed" if changed else "healthy",
                "reason": "",
                "probability": 0.97 if changed else 0.02,
                "discovery": changed and k < 5,
                "since": 20 if changed else 0,
                "since_low": 18,
                "since_high": 23,
                "since_flight": "F20" if changed else "",
                "severity": estimate(size, 2.0),
                "severity_unit": "K",
                "health": health,
                "by_flight": by_flight,
                "events": [
                    {
                        "event": {
                            "engine": f"ESN-{1000 + k}",
                            "kind": "wash",
                            "flight": "F40",
                            "time_s": None,
                            "component": "",
                        },
                        "number": 40,
                        "gains": {},
                        "recovered_K": estimate(2.1, 1.0),
                        "reason": "",
                    }
                ],
                "margin": {
                    "column": "T5_K",
                    "condition": "take-off at sea level",
                    "limit_K": 950.0,
                    "consumed_K": estimate(size * 0.66, 1.0),
                    "now_K": estimate(45.0 - size * 0.66, 1.5),
                    "remaining_flights": {
                        "value": 120.0 + 9 * k,
                        "low": 80.0,
                        "high": None if k == 2 else 200.0 + 9 * k,
                    },
                    "rate_K_per_flight": estimate(0.3, 0.1),
                    "reason": "",
                },
                "baseline": 10,
            }
        )
    common = {
        "parameter": "lpt.efficiency",
        "words": "LPT efficiency",
        "unit": "1",
        "mean": estimate(0.003, 0.0004),
        "spread": 0.0004,
        "engines": engines,
        "alike": 0.98,
        "common": True,
        "reading": "rose alike in most engines",
    }
    words = "Of the engines listed, at most 5 % are healthy on average, however many flights are looked at."
    return _json(
        folder / "fleet.json",
        {
            "schema": "enginediag/fleet/2",
            "description": "Thirty engines",
            "engines": found,
            "common": [common],
            "discoveries": {"engines": [e["serial"] for e in found if e["discovery"]], "level": 0.05, "words": words},
            "left_out": [{"recording": "bad.csv", "reason": "no column T3_K"}],
            "provenance": ["enginediag: 0.4.0", "command: fleet"],
        },
    )


def engine_files(folder: Path, engine: str = "") -> list[Path]:
    """All of one engine."""
    return [made(folder, engine) for made in (detected, isolated, followed, trend)]


def _written(path: Path, rows: Sequence[str]) -> Path:
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def _json(path: Path, value: Any) -> Path:
    path.write_text(json.dumps(value, ensure_ascii=False), encoding="utf-8")
    return path

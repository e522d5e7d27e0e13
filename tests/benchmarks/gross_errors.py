"""Gross errors in judged recordings: python tests/benchmarks/gross_errors.py [--seeds A B] [--engines NAME ...]

Healthy and faulty flights of several engines are simulated, identified and judged by the commands, as they are and with
gross errors put in: 0.2 % of all cells 999 or 0, 1 % of the sensors' or of the inputs' cells off by 10 to 30 standard
deviations, two bursts of five records a flight, one dead sensor a flight. A table goes to standard output (each row to
a file, too, with --json): false alarms of windows (one per flight) and of --follow with the most that the stated rate
allows, and flights of which exactly the component or the instrument at fault is named, beside how many are of the same
flights with what was made wrong deleted: all that there is to know. Then, on clean data, what the rejection costs:
smallest detectable changes, statistic of true faults and detection delay in records, with it and without, of all faults
and of those that no one channel alone shows: what one shows is an alarm when it has lasted longer than a gross error.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from scipy.stats import binom

sys.path.insert(0, str(Path(__file__).parent))

from end_to_end import ROOT, run

from enginediag_cli.engine.instrument_errors import OF_NOISE, InputErrors
from enginediag_cli.history import follow
from enginediag_cli.intake.selection import open_baseline
from enginediag_cli.residuals import gross_gate
from enginediag_cli.residuals import gross_gate as live_gate
from enginediag_cli.residuals.monitor import Monitor, build_monitor
from enginediag_cli.units import split_column

FLIGHTS = {
    "turbofan": "airliner",
    "turboshaft": "helicopter",
    "turbojet": "business_jet",
    "naval_gas_generator": "naval",
    "three_spool_turbofan": "airliner",
}
"""Engines, and how each is flown."""
RECORDS = 130
"""Records of a flight at most: longer ones are thinned."""
TRAINING = 8
"""Flights that an engine is identified from."""
RATES = (0.01, 0.05)
BLOCKS = {"delay": 20, "delay in blocks of 5": 5}
"""Detection delays, and in which blocks records are followed; the first of a flight is what the last one leaves."""
HEADS = ("engine", "seed", "data")
"""What a measured row is of."""
Row = list[str]


class Table:
    """Rows of a recording, cells as text."""

    def __init__(self, names: Row, rows: list[Row]):
        self.names, self.rows = names, rows
        self.dead: dict[str, str] = {}
        """Flight → the parameter of a sensor that is stuck in it, which is at fault, too."""

    @classmethod
    def read(cls, path: Path) -> Table:
        with open(path, encoding="utf-8", newline="") as stream:
            names, *rows = csv.reader(line for line in stream if not line.startswith("#"))
        return cls(names, rows)

    def write(self, path: Path) -> Path:
        with open(path, "w", encoding="utf-8", newline="") as stream:
            csv.writer(stream).writerows([self.names, *self.rows])
        return path

    def flights(self) -> list[list[int]]:
        at = self.names.index("flight")
        names = [row[at] for row in self.rows]
        return [[i for i, name in enumerate(names) if name == flight] for flight in dict.fromkeys(names)]

    def thinned(self) -> Table:
        kept = []
        for rows in self.flights():
            step = -(-len(rows) // RECORDS)
            kept += [self.rows[i] for i in rows[::step]]
        return Table(self.names, kept)

    def copy(self) -> Table:
        return Table(self.names, [row[:] for row in self.rows])

    def add(self, row: int, column: str, amount: float) -> None:
        j = self.names.index(column)
        self.rows[row][j] = f"{float(self.rows[row][j]) + amount:.10g}"

    def put(self, row: int, column: str, text: str) -> None:
        self.rows[row][self.names.index(column)] = text


class Sizes:
    """Sensors and recorded inputs of an engine, and the standard deviation of each at a row of a table."""

    def __init__(self, monitor: Monitor, table: Table):
        self.sensors = [c for c in monitor.sensors if c in table.names]
        self.inputs = [c for c in monitor.engine.inputs if c in table.names]
        self._sigma = dict(zip(monitor.sensors, monitor.noise.sigma.tolist(), strict=True))
        self._errors = {e.column: e for e in getattr(InputErrors.wrap(monitor.engine), "errors", {}).values()}

    def of(self, table: Table, row: int, column: str) -> float:
        if column in self._sigma:
            return self._sigma[column]
        value = abs(float(table.rows[row][table.names.index(column)]))
        error = self._errors.get(column)
        if error is None:
            return 0.003 * value
        return error.parameter.prior_sigma / OF_NOISE * (value if error.multiplies else 1.0)


def spikes(table: Table, sizes: Sizes, columns: Sequence[str], rng: np.random.Generator) -> Table:
    """1 % of the cells of some columns off by 10 to 30 standard deviations."""
    found = table.copy()
    for i in range(len(found.rows)):
        for column in columns:
            if rng.random() < 0.01:
                found.add(i, column, rng.choice([-1, 1]) * rng.uniform(10, 30) * sizes.of(table, i, column))
    return found


def fillers(table: Table, sizes: Sizes, rng: np.random.Generator) -> Table:
    """0.2 % of all cells 999 or 0."""
    found = table.copy()
    for i in range(len(found.rows)):
        for column in (*sizes.sensors, *sizes.inputs):
            if rng.random() < 0.002:
                found.put(i, column, str(rng.choice(["999", "0"])))
    return found


def bursts(table: Table, sizes: Sizes, rng: np.random.Generator) -> Table:
    """Two bursts of five records a flight, each of one sensor or input."""
    found = table.copy()
    for rows in table.flights():
        for _ in range(2):
            first, column = int(rng.integers(0, len(rows) - 5)), str(rng.choice([*sizes.sensors, *sizes.inputs]))
            amount = rng.choice([-1, 1]) * rng.uniform(10, 30)
            for i in rows[first : first + 5]:
                found.add(i, column, amount * sizes.of(table, i, column))
    return found


def dead(table: Table, sizes: Sizes, rng: np.random.Generator) -> Table:
    """One sensor a flight reads 0, 999 or its first value from somewhere in the first half on."""
    found = table.copy()
    for rows in table.flights():
        column, first = str(rng.choice(sizes.sensors)), int(rng.integers(0, len(rows) // 2))
        found.dead[table.rows[rows[0]][table.names.index("flight")]] = f"sensor.{split_column(column)[0]}.stuck"
        text = str(rng.choice(["0", "999", table.rows[rows[first]][table.names.index(column)]]))
        for i in rows[first:]:
            found.put(i, column, text)
    return found


def corrupted(table: Table, sizes: Sizes, seed: int) -> Iterator[tuple[str, Table]]:
    """Name and recording of every kind of gross error."""
    rng = np.random.default_rng(seed)
    yield "clean", table
    yield "0.2 % of cells 999 or 0", fillers(table, sizes, rng)
    yield "1 % spikes of sensors", spikes(table, sizes, sizes.sensors, rng)
    yield "1 % spikes of inputs", spikes(table, sizes, sizes.inputs, rng)
    yield "two bursts of five", bursts(table, sizes, rng)
    yield "one dead sensor", dead(table, sizes, rng)


def deleted(clean: Table, spoilt: Table, sizes: Sizes) -> Table:
    """The clean recording without the readings that were made wrong, and without any in records with a wrong input."""
    found = clean.copy()
    for i, (right, wrong) in enumerate(zip(clean.rows, spoilt.rows, strict=True)):
        columns = [c for c, a, b in zip(clean.names, right, wrong, strict=True) if a != b]
        for column in sizes.sensors if set(columns) & set(sizes.inputs) else columns:
            found.put(i, column, "")
    return found


def rows_of(path: Path) -> list[dict[str, str]]:
    with open(path, encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def simulated(engine: str, folder: Path, name: str, flights: int, seed: int, *more: object) -> Table:
    configs, path = ROOT / "configs", folder / f"{name}.csv"
    flight = configs / "flights" / f"{FLIGHTS[engine]}.yaml"
    named = ("--flight", flight, "--flights", flights, "--seed", seed)
    run("simulate", configs / f"{engine}.yaml", *named, *more, "-o", path)
    return Table.read(path).thinned()


def false_alarms(nominal: Path, path: Path) -> dict[str, int]:
    """Flights, alarms of windows at both rates, flights without verdict, and alarms of --follow at the first rate."""
    out = path.with_suffix(".out.csv")
    found = {"flights": 0}
    for rate in RATES:
        run("detect", "-n", nominal, path, "--false-alarm", rate, "-o", out, accepted=(0, 3))
        rows = rows_of(out)
        found |= {"flights": len(rows), f"alarms at {rate:g}": sum(r["verdict"] == "fault" for r in rows)}
        found["no verdict"] = sum(r["verdict"] == "no verdict" for r in rows)
    run("detect", "-n", nominal, path, "--false-alarm", RATES[0], "--follow", "--idle", 0, "-o", out, accepted=(0, 3))
    followed = {r["flight"]: r["alarm"] for r in rows_of(out)}
    return {**found, "follow alarms": sum(a.lower() in ("true", "1", "yes") for a in followed.values())}


def faulty(engine: str, monitor: Monitor, folder: Path, n: int, seed: int) -> tuple[Table, list[str]]:
    """n flights, each with a component or (every third) an instrument at fault, and the parameter of each."""
    rng = np.random.default_rng(seed)
    health = [p for p in monitor.monitored if monitor.meaning[p].quantity in ("efficiency", "flow_capacity")]
    tables, truth = [], []
    for k in range(n):
        if k % 3 == 2:
            table = simulated(engine, folder, "f", 1, seed + k)
            column = str(rng.choice([c for c in monitor.sensors if c in table.names]))
            sigma = monitor.noise.sigma[monitor.sensors.index(column)]
            size = rng.choice([-1, 1]) * rng.uniform(3, 8) * sigma
            for i in range(len(table.rows)):
                table.add(i, column, size)
            truth.append(f"sensor.{split_column(column)[0]}.bias")
        else:
            name, size = str(rng.choice(health)), -rng.uniform(0.01, 0.04)
            fault = folder / "fault.yaml"
            text = f"kind: faults\nfaults:\n  - {{name: f, assumed: true, changes: {{{name}: {size:.4f}}}, "
            fault.write_text(text + "law: {type: step, clock: flight, onset: 1}}\n", encoding="utf-8")
            table = simulated(engine, folder, "f", 1, seed + k, "--fault", fault)
            truth.append(name)
        at = table.names.index("flight")
        for row in table.rows:
            row[at] = str(k + 1)
        tables.append(table)
    return Table(tables[0].names, [row for table in tables for row in table.rows]), truth


def exact(nominal: Path, path: Path, truth: Sequence[str], dead: Mapping[str, str]) -> int:
    """Flights of which the parameter at fault is named, and nothing else, save a dead sensor by its flight; where that
    is the one at fault, it is named as stuck, since it has no other form."""
    out = path.with_suffix(".out.json")
    run("isolate", "-n", nominal, path, "--format", "json", "-o", out, accepted=(0, 3))
    document = json.loads(out.read_text(encoding="utf-8"))
    rows = document["rows"] if isinstance(document, dict) else document
    named = {str(r["flight"]): set(r.get("isolated") or ()) for r in rows}
    right = 0
    for flight, name in ((str(k + 1), name) for k, name in enumerate(truth)):
        stuck = dead.get(flight, "")
        same = stuck.rsplit(".", 1)[0] == name.rsplit(".", 1)[0]
        right += named.get(flight, set()) - (set() if same else {stuck}) == ({stuck} if same else {name})
    return right


@contextmanager
def without_rejection() -> Iterator[None]:
    """Everything as it is, but nothing is taken for a gross error, nor for what may be one."""
    kept = gross_gate.may_have_gross_errors, live_gate.may_have_gross_errors, follow.find_brief_departures
    gross_gate.may_have_gross_errors = live_gate.may_have_gross_errors = lambda *_: False
    follow.find_brief_departures = lambda t, *_: np.zeros(t.shape, bool)
    try:
        yield
    finally:
        gross_gate.may_have_gross_errors, live_gate.may_have_gross_errors, follow.find_brief_departures = kept


def delays(path: Path) -> dict[str, tuple[int, bool]]:
    """Of each flight with an alarm of --follow: records to the end of the block with the first one, and whether one
    channel alone had spoken for it in a block before."""
    records: Counter[str] = Counter()
    found: dict[str, tuple[int, bool]] = {}
    alone = set()
    for r in rows_of(path):
        flight = r["flight"]
        records[flight] += int(r["records"])
        if r["alarm"].lower() in ("true", "1", "yes"):
            found.setdefault(flight, (records[flight], flight in alone))
        elif r["reason"].startswith("one channel decides"):
            alone.add(flight)
    return found


def cost(nominal: Path, healthy: Path, wrong: Path) -> dict[str, float]:
    """Ratios with over without rejection, on clean data: interval width, statistic of true faults, detection delay."""
    found: dict[str, list[np.ndarray]] = {"width": [], "statistic": []}
    seen: dict[str, list[dict[str, tuple[int, bool]]]] = {name: [] for name in BLOCKS}
    for rejects in (True, False):
        with _nothing() if rejects else without_rejection():
            out = healthy.with_suffix(".cost.csv")
            run("detect", "-n", nominal, healthy, "--detectable", "-o", out, accepted=(0, 3))
            rows = rows_of(out)
            sizes = [c for c in rows[0] if c.startswith("detectable:")]
            found["width"].append(np.array([[float(r[c] or "nan") for c in sizes] for r in rows]))
            run("detect", "-n", nominal, wrong, "-o", out, accepted=(0, 3))
            found["statistic"].append(np.array([float(r["statistic"] or "nan") for r in rows_of(out)]))
            for name, block in BLOCKS.items():
                live = ("--follow", "--idle", 0, "--window", block)
                run("detect", "-n", nominal, wrong, *live, "-o", out, accepted=(0, 3))
                seen[name].append(delays(out))
    ratio = {k: float(np.nanmean(a / b)) for k, (a, b) in found.items()}
    for name, (now, before) in seen.items():
        both = now.keys() & before.keys()
        several = [f for f in both if not now[f][1]]
        for kind, flights in ((name, both), (f"{name}, several channels", several)):
            ratio[kind] = sum(now[f][0] for f in flights) / sum(before[f][0] for f in flights) if flights else np.nan
        ratio |= {f"{name}, one channel": len(both) - len(several), f"{name}, not seen": len(before) - len(both)}
    return ratio


@contextmanager
def _nothing() -> Iterator[None]:
    yield


def measured(engine: str, seed: int, flights: int, faults: int) -> Iterator[dict[str, object]]:
    """A row for each kind of gross error of one engine and seed, the last one what the rejection costs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        nominal = folder / "nominal.yaml"
        training = simulated(engine, folder, "training", TRAINING, seed)
        run("identify", ROOT / "configs" / f"{engine}.yaml", training.write(folder / "t.csv"), "-o", nominal)
        monitor = build_monitor(open_baseline(str(nominal)))
        healthy = simulated(engine, folder, "healthy", flights, seed + 1)
        wrong, truth = faulty(engine, monitor, folder, faults, seed + 1000)
        sizes = Sizes(monitor, healthy)
        both = zip(corrupted(healthy, sizes, seed), corrupted(wrong, sizes, seed + 1), strict=True)
        for (kind, table), (_, spoilt) in both:
            row: dict[str, object] = {"engine": engine, "seed": seed, "data": kind}
            row |= false_alarms(nominal, table.write(folder / "h.csv"))
            row |= {"faults": faults, "exact": exact(nominal, spoilt.write(folder / "w.csv"), truth, spoilt.dead)}
            left = deleted(wrong, spoilt, sizes).write(folder / "l.csv")
            row["exact of what is left"] = row["exact"] if kind == "clean" else exact(nominal, left, truth, {})
            yield row
        paths = healthy.write(folder / "h.csv"), wrong.write(folder / "w.csv")
        yield {"engine": engine, "seed": seed, "data": "cost on clean data", **cost(nominal, *paths)}


def table_of(rows: Sequence[dict[str, object]]) -> Iterator[str]:
    """Sums over engines and seeds, with the most alarms that the stated rate allows in 97.5 % of such trials."""
    yield "| data | flights | windows at 1 % | at 5 % | follow at 1 % | no verdict | exact | wrong cells deleted |"
    yield "|---|---|---|---|---|---|---|---|"
    kinds = [k for k in dict.fromkeys(str(r["data"]) for r in rows) if k != "cost on clean data"]
    for kind in kinds:
        mine = [r for r in rows if r["data"] == kind]
        n, *counts, silent, follow = (
            sum(int(str(r[c])) for r in mine)
            for c in ("flights", *(f"alarms at {rate:g}" for rate in RATES), "no verdict", "follow alarms")
        )
        most = [int(binom.ppf(0.975, n, rate)) for rate in RATES]
        right, best, of = (sum(int(str(r[c])) for r in mine) for c in ("exact", "exact of what is left", "faults"))
        windows = " | ".join(f"{c} (≤ {m})" for c, m in zip(counts, most, strict=True))
        yield f"| {kind} | {n} | {windows} | {follow} (≤ {most[0]}) | {silent} | {right} of {of} | {best} |"
    costs = [r for r in rows if r["data"] == "cost on clean data"]
    if costs:
        mean = {k: float(np.nanmean([float(str(r[k])) for r in costs])) for k in costs[0] if k not in HEADS}
        delay = ", ".join(f"{k} {mean[k]:.3f}" for name in BLOCKS for k in (name, f"{name}, several channels"))
        yield (
            f"\nClean data, with over without rejection: smallest detectable changes {mean['width']:.4f}, statistic of "
            f"true faults {mean['statistic']:.4f}; {delay}."
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12], help="one trial of every engine for each")
    parser.add_argument("--engines", nargs="+", choices=list(FLIGHTS), default=list(FLIGHTS))
    parser.add_argument("--flights", type=int, default=20, help="healthy flights of each")
    parser.add_argument("--faults", type=int, default=12, help="faulty flights of each")
    parser.add_argument("--json", help="add each row to this file as it is measured, a JSON document a line")
    options = parser.parse_args()
    rows = []
    for seed in options.seeds:
        for engine in options.engines:
            for row in measured(engine, 10_000 * seed, options.flights, options.faults):
                rows.append(row)
                print(json.dumps(row), file=sys.stderr, flush=True)
                if options.json:
                    with open(options.json, "a", encoding="utf-8") as stream:
                        print(json.dumps(row), file=stream)
    print("\n".join(table_of(rows)))


if __name__ == "__main__":
    main()

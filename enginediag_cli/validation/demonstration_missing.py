"""The demonstration of missing physics: an effect that the model lacks and no column shows.

The steps are the command lines that a user would type to find it. What was concealed is compared with the answers, read
back from the files that locate, explain, refine and detect wrote.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.sentences import rounded
from enginediag_cli.units import split_column

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
    """Command line that records flights of the engine that has the effect."""
    flown = f"--flight {FLIGHTS} --flights {flights} --seed {seed}"
    return f"simulate {TRUTH} {flown} --no-header -o {recording}".split()


def locate() -> list[str]:
    """Command line that shows where model and recordings differ."""
    return f"locate {ENGINE} {RECORDED} --picture {MAP} -o {LOCATED}".split()


def explain() -> list[str]:
    """Command line that searches for the missing effect."""
    return f"explain {ENGINE} {RECORDED} --no-advice -o {EXPLAINED}".split()


def refine(effects: Sequence[str]) -> list[str]:
    """Command line that adds effects to the model and compares both on unseen flights."""
    terms = " ".join(f"--term {label}" for label in effects)
    judged = f"--test {UNSEEN} --window {WINDOW}"
    return (
        f"refine {ENGINE} {RECORDED} {terms} {judged} -o {REFINED} --report {REPORT} --picture {BEFORE_AFTER}".split()
    )


def nominal_file(engine: str) -> str:
    """Nominal file of an engine file."""
    return f"{Path(engine).stem}_nominal.yaml"


def verdict_file(engine: str) -> str:
    """File of the verdicts of an engine file on unseen flights."""
    return f"{Path(engine).stem}_detected.json"


def identify(engine: str) -> list[str]:
    """Command line that identifies an engine on the recorded flights."""
    return f"identify {engine} {RECORDED} --no-cross-validation -o {nominal_file(engine)}".split()


def detect(engine: str) -> list[str]:
    """Command line that judges the unseen flights by an engine."""
    return f"detect -n {nominal_file(engine)} {UNSEEN} --window {WINDOW} -o {verdict_file(engine)}".split()


def report() -> list[str]:
    """Command line that reports all answers as one page."""
    return f"report {LOCATED} {EXPLAINED} {REPORT} -o {PAGE}".split()


def named_effects(explained: Path) -> list[str]:
    """Effects of the first explanation in a JSON file of `explain`; none where it named none, or a fault."""
    first = json.loads(explained.read_text(encoding="utf-8"))["explanations"][:1]
    if not first or set(first[0]["kinds"]) != {"effect"}:
        return []
    return str(first[0]["name"]).split(" + ")


SENSORS_TOLD = 3
"""Those whose residual fell most; the others are in the file."""
NOMINAL, SURPRISING = 0.01, 0.01
"""Rate of false alarms that detect states, and the probability below which a higher count is reported as wrong."""


@dataclass(frozen=True)
class MissingPhysicsResults:
    """Answers as the commands wrote them: rows of `locate`, documents of `explain` and `refine`, and rows of `detect`
    on unseen flights, with the engine as it was given, as it was refined, and as it flew."""

    located: Sequence[Mapping[str, Any]]
    explained: Mapping[str, Any]
    refined: Mapping[str, Any]
    before: Sequence[Mapping[str, Any]]
    after: Sequence[Mapping[str, Any]]
    true: Sequence[Mapping[str, Any]]


def read_results() -> MissingPhysicsResults:
    """From the working folder."""
    paths = (LOCATED, EXPLAINED, REPORT, *map(verdict_file, (ENGINE, REFINED, TRUTH)))
    return MissingPhysicsResults(*(read_json(path) for path in paths))


def read_json(path: str) -> Any:
    return json.loads(Path(path).read_text(encoding="utf-8"))


def describe_concealed() -> Iterator[str]:
    """What is done, before any of it."""
    yield f"{TRUTH} is {ENGINE} with these lines added:"
    yield from (f"  {line}" for line in CARRIED.splitlines())
    yield "It flies; what follows is given its recordings and the engine file without these lines."


def describe_alarms(rows: Sequence[Mapping[str, Any]], engine: str) -> str:
    """What `detect` did on the unseen flights, which are healthy."""
    alarms, windows = _alarms(rows)
    return f"{engine}: {alarms} of {windows} windows of healthy flights raise an alarm (nominal 1 %)"


def comparison(found: MissingPhysicsResults) -> Iterator[str]:
    """Concealed and found, before and after, and everything that is wrong."""
    place = found.located[0]
    yield f"concealed: {TERM}@{SITE}, {COEFFICIENT} {SIZE:g}"
    where = f"{place['location']} along {place['driver']}" if place["location"] else "no place"
    yield f"locate:    {where} ({place['verdict']})"
    yield f"explain:   {' or '.join(x['name'] for x in found.explained['explanations'])}"
    yield f"refine:    {'; '.join(_fitted(found))}"
    yield ""
    yield from table(found)
    yield from (f"! {mistake}" for mistake in mistakes(found))


def table(found: MissingPhysicsResults) -> Iterator[str]:
    """Before and after on the unseen flights: totals, then the sensors that gain most."""
    chi2 = found.refined["chi2_per_reading"]
    one, other, true = (f"{a} of {n}" for a, n in map(_alarms, (found.before, found.after, found.true)))
    lines = [
        ("χ² per reading", f"{chi2['before']:.3f}", f"{chi2['after']:.3f}"),
        ("windows with a false alarm", one, other),
    ]
    rms = [row for row in found.refined["rows"] if row["what"] == "rms"]
    rms.sort(key=lambda row: row["after"] / row["before"])
    for row in rms[:SENSORS_TOLD]:
        what = f"RMS of {split_column(row['of'])[0]}'s residual"
        lines.append((what, f"{rounded(row['before'])} {row['unit']}", f"{rounded(row['after'])} {row['unit']}"))
    width = max(len(what) for what, _, _ in lines)
    yield f"{'on unseen flights':{width}}  {'before':>10}  {'after':>10}"
    yield from (f"{what:{width}}  {one:>10}  {other:>10}" for what, one, other in lines)
    yield f"with the engine that flew, {true} windows have a false alarm"


def mistakes(found: MissingPhysicsResults) -> Iterator[str]:
    """A wrong place or name, alternatives that were not excluded, and what did not improve."""
    from scipy.stats import binom

    wanted = f"{TERM}@{SITE}"
    names = [x["name"] for x in found.explained["explanations"]]
    if found.located[0]["component"] != SITE:
        yield f"locate put another place first: {found.located[0]['location']}"
    if wanted not in names:
        yield f"explain did not name what was concealed: {' or '.join(names) or 'nothing'}"
    elif len(names) > 1:
        yield f"explain could not exclude {' or '.join(n for n in names if n != wanted)}"
    for name, _, _, low, high in _coefficients(found):
        if name == COEFFICIENT and not low <= SIZE <= high:
            yield f"the true {name} {SIZE:g} lies outside its 95 % interval, {low:.3f} to {high:.3f}"
    if found.refined["chi2_per_reading"]["after"] >= found.refined["chi2_per_reading"]["before"]:
        yield "unseen flights do not fit better"
    if _alarms(found.after)[0] > _alarms(found.before)[0]:
        yield "the refined engine raises more false alarms"
    alarms, windows = _alarms(found.after)
    if binom.sf(alarms - 1, windows, NOMINAL) < SURPRISING:
        yield (
            f"the refined engine raises {alarms} alarms in {windows} windows, more than chance at nominal 1 %; the "
            f"engine that flew, {_alarms(found.true)[0]} in {_alarms(found.true)[1]}"
        )


def closing(found: MissingPhysicsResults) -> str:
    """One sentence."""
    wrong = sum(1 for _ in mistakes(found))
    if not wrong:
        return (
            "What was concealed was located, named and put into the model, its true size lies inside its 95 % "
            "interval, and flights that were not used fit better."
        )
    return f"{wrong} {'thing was' if wrong == 1 else 'things were'} missed or wrong, marked with ! above."


def _alarms(rows: Sequence[Mapping[str, Any]]) -> tuple[int, int]:
    """Windows that alarm, and windows that were judged."""
    verdicts = [row["verdict"] for row in rows]
    return verdicts.count("fault"), len(verdicts) - verdicts.count("no verdict")


def _coefficients(found: MissingPhysicsResults) -> Iterator[tuple[str, str, float, float, float]]:
    """Name, its effect, value and 95 % interval of what refine fitted."""
    for e in found.refined["effects"]:
        label = f"{e['term']}@{e['at']}"
        for name, value in e["coefficients"].items():
            error = found.refined["standard_errors"].get(f"{e['term']}.{e['at']}.{name}", float("nan"))
            yield name, label, value, value - NORMAL_95 * error, value + NORMAL_95 * error


def _fitted(found: MissingPhysicsResults) -> Iterator[str]:
    for name, label, value, low, high in _coefficients(found):
        yield f"{label}, {name} {rounded(value, (high - low) / 2)} (95 % interval {low:.3f} to {high:.3f})"

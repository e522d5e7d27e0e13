"""The words of the field that the program uses, each with its meaning, unit and place in the program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

LINE = 100
"""Characters of a line of the text on a terminal."""


class GlossaryEntry(NamedTuple):
    """A word: its meaning in one or two sentences, its unit, where the program uses it, and other words for it."""

    word: str
    meaning: str
    used: str
    unit: str = ""
    also: tuple[str, ...] = ()


_E = GlossaryEntry

GLOSSARY: tuple[GlossaryEntry, ...] = (
    _E(
        "ambiguity group",
        "Causes that the data cannot separate: each fits as well as the others. More sensors or other operating points "
        "may separate them.",
        "isolate, explain: rivals; locate: a = b",
        also=("alternative hypotheses", "rivals"),
    ),
    _E(
        "baseline",
        "Reference from which changes are counted: the nominal engine, or the first flights of an engine.",
        "detect --reference, trend --baseline, fleet",
    ),
    _E(
        "Bayesian model averaging",
        "Estimate averaged over several possible explanations, each weighted with its posterior probability.",
        "isolate: column change; explain: averaged formulas",
        also=("model averaging",),
    ),
    _E(
        "bleed",
        "Air taken from a compressor for cooling, customers or surge control.",
        "engine files; physics: customer_bleed, handling_bleed",
        "share of flow",
    ),
    _E(
        "change detection",
        "Test for a difference between recent data and the nominal state. It does not name the cause; isolation does.",
        "detect",
        also=("fault detection",),
    ),
    _E(
        "component map",
        "Table or formula of a turbomachine: flow, pressure ratio and efficiency over corrected speed.",
        "engine files: map, table; components",
        also=("map", "compressor map", "turbine map"),
    ),
    _E(
        "corrected",
        "Referred to ISA sea level (288.15 K, 101325 Pa), so that points at different inlet conditions can be "
        "compared.",
        "component maps, drivers",
    ),
    _E(
        "covariance",
        "Joint uncertainty of several estimates. Identification stores that of the nominal parameters.",
        "nominal file; residual: nuisance columns",
    ),
    _E(
        "credible interval",
        "Interval that contains the true value with the stated posterior probability, 95 % unless stated otherwise.",
        "isolate, trend, explain: columns low and high",
        "of the parameter",
        ("confidence interval",),
    ),
    _E(
        "cross-validation",
        "Fit without a block of records, then predict this block. Its errors measure how well the model generalises.",
        "identify",
    ),
    _E(
        "delta",
        "Difference between a reading and the model's prediction at the same operating condition, such as ΔEGT, ΔWf, "
        "ΔN2.",
        "residual --what records",
        "of the reading",
        ("ΔEGT", "ΔWf", "ΔN2", "residual"),
    ),
    _E(
        "detection delay",
        "Number of records between the onset of a change and the alarm.",
        "detect --follow",
        "records or s",
    ),
    _E(
        "deterioration",
        "Gradual loss of component health by wear, erosion and fouling.",
        "trend: kind deterioration; fleet",
        "of the parameter per flight",
        ("wear", "degradation"),
    ),
    _E(
        "driver",
        "Quantity on which an effect or a discrepancy depends, such as Mach number, altitude or hours in service.",
        "locate, explain: driver; --driver",
    ),
    _E(
        "dynamic effect",
        "Effect with memory: its size depends on the past, such as heat soak or a lagging probe.",
        "simulate, explain; physics",
        also=("effect with memory",),
    ),
    _E(
        "EGT margin",
        "Distance of the turbine temperature from its limit at the hottest operating point, takeoff for an airliner. "
        "Deterioration consumes it, maintenance restores part of it.",
        "trend --what margin, fleet, report",
        "K",
        ("ITT margin", "MGT margin", "EGT margin used"),
    ),
    _E(
        "efficiency",
        "Isentropic efficiency of a compressor or turbine. As a health parameter it is a factor on the map, nominal 1.",
        "hpc.efficiency and the like",
        "1",
    ),
    _E(
        "empirical correction",
        "Formula for an effect that is not in the library, found from the data. An engine file can carry it as `law:`.",
        "explain: status law; refine",
        also=("law", "formula"),
    ),
    _E(
        "envelope",
        "Range of operating conditions covered by the healthy recordings. Outside it limits widen, because the model "
        "was not tested there.",
        "identify; detect: records outside; check -n",
    ),
    _E(
        "excluded data",
        "Records or readings that are not used, each with its reason: unsteady, frozen, outlier, outside the envelope.",
        "all commands that read recordings; check",
        also=("masked",),
    ),
    _E(
        "false-alarm rate",
        "Probability that a healthy window, or with --follow a healthy flight, raises an alarm.",
        "detect --false-alarm",
        "1",
        ("false alarm", "significance level"),
    ),
    _E(
        "false discovery rate",
        "Expected share of healthy engines among those that are flagged.",
        "fleet: engines flagged, at most 5 %",
        "1",
    ),
    _E(
        "fault catalogue",
        "Named faults as directions in parameter space, such as compressor fouling: efficiency and flow fall together.",
        "isolate --catalogue, simulate --fault",
    ),
    _E(
        "flow capacity",
        "Corrected flow that a compressor or turbine passes. As a health parameter it is a factor on the map, nominal "
        "1.",
        "hpt.flow_capacity and the like",
        "1",
    ),
    _E(
        "forecast",
        "Number of flights until the EGT margin is used up at the present rate, with an interval.",
        "trend --what margin, fleet",
        "flights",
        ("prognosis", "remaining useful life"),
    ),
    _E(
        "GLR test",
        "Generalised likelihood ratio test: compares the best fit with a change to the fit without one.",
        "detect: statistic, threshold, p_value",
        also=("likelihood ratio",),
    ),
    _E(
        "gross error",
        "Single reading far outside its noise, such as a spike. It is excluded from statistics and counted.",
        "residual, detect, check",
        also=("outlier", "spike"),
    ),
    _E(
        "health parameter",
        "Factor or offset on a component that is 1 or 0 for the nominal engine: efficiency, flow capacity, area.",
        "engine files: monitored parameters; isolate, trend",
        "mostly 1",
    ),
    _E(
        "identifiability",
        "Whether the healthy recordings determine a parameter of the engine. The others keep their prior.",
        "identify: report",
        also=("not identifiable",),
    ),
    _E(
        "identification",
        "Fit of engine parameters, sensor offsets and noise to healthy recordings of one engine.",
        "identify",
        also=("calibration", "adaptation"),
    ),
    _E(
        "isolability",
        "Whether the data can tell a change of one parameter from changes of others.",
        "isolate --advise",
    ),
    _E(
        "isolation",
        "Search for the parameters, sensors or components that changed, with sizes and probabilities.",
        "isolate",
        also=("fault isolation", "diagnosis"),
    ),
    _E(
        "linearisation",
        "Replacement of the model near one point by its derivatives. --linearise chooses the point.",
        "detect, isolate, trend",
    ),
    _E(
        "local approach",
        "Statistical theory of small changes (Basseville, Benveniste): a window is reduced to a normal vector s with "
        "mean F·δ and covariance V, where δ is the change.",
        "residual; isolate --method incremental, sensitivity, minmax",
    ),
    _E(
        "map error",
        "Error of the component maps, as a smooth function of their coordinates. It is identified with its "
        "uncertainty, and a deviation within it is no finding.",
        "identify, --model-error",
        "relative",
        ("model error",),
    ),
    _E(
        "marginal likelihood",
        "Probability of the data under a hypothesis, averaged over its unknown sizes. It rewards fit and punishes "
        "freedom.",
        "isolate, explain",
        also=("evidence", "Bayes factor"),
    ),
    _E(
        "model inadequacy",
        "Systematic difference between model and engine that no parameter explains.",
        "locate, explain; column fit",
        also=("discrepancy", "mismatch", "missing physics"),
    ),
    _E(
        "module",
        "Part of an engine that is removed and repaired as a whole: fan, HPC, HPT and so on.",
        "isolate --by component, work scope",
        also=("component",),
    ),
    _E(
        "monitored parameter",
        "Parameter that a test may report as changed.",
        "engine files; --monitor",
    ),
    _E(
        "nominal file",
        "YAML file with the identified state of one healthy engine: parameters, covariance, noise, envelope and the "
        "engine itself.",
        "identify -o; -n in other commands",
        also=("nominal engine", "nominal state"),
    ),
    _E(
        "nuisance parameter",
        "Unknown that is not of interest but affects the readings, such as a sensor offset. It is integrated out.",
        "residual: nuisance columns",
    ),
    _E(
        "observability",
        "Whether the sensors show a change of a parameter at all. A window says which parameters it does not excite.",
        "detect --detectable, isolate",
        also=("excitation",),
    ),
    _E(
        "onset",
        "Record or flight at which a change began.",
        "trend, detect --follow",
        "flight or s",
    ),
    _E(
        "p value",
        "Probability of a statistic at least this large if nothing has changed. Below the false-alarm rate it is an "
        "alarm.",
        "detect, locate",
        "1",
    ),
    _E(
        "posterior probability",
        "Probability of a hypothesis after the data, from prior and marginal likelihood.",
        "isolate, explain, trend: probability",
        "1",
    ),
    _E(
        "power",
        "Probability that a test detects a change of a given size. Of an engine: its shaft power or power setting.",
        "detect --power",
        "1",
        ("probability of detection",),
    ),
    _E(
        "prior",
        "What is assumed before the data: the probability that something changed, and its plausible size.",
        "isolate --inclusion, --sensor-inclusion; engine files: prior_sigma",
    ),
    _E(
        "recorder",
        "Description of a foreign recording: its columns, units and time stamps, as a YAML file.",
        "recorder, --recorder",
    ),
    _E(
        "reduced χ²",
        "χ² per degree of freedom of what the answer leaves unexplained: near 1 when model and noise are right.",
        "column fit",
        "1",
        ("chi-squared", "goodness of fit", "lack of fit"),
    ),
    _E(
        "Reynolds index",
        "Reynolds number relative to sea level. At low values, high altitude, component efficiencies fall.",
        "drivers; physics: reynolds_efficiency",
        "1",
    ),
    _E(
        "sensitivity of the conclusion",
        "The smallest error of a sensor, input or map, or change of the prior, that would change the diagnosis.",
        "isolate --flips",
        "of the input or in σ",
        ("flips", "robustness"),
    ),
    _E(
        "sequential test",
        "Test after every block of records whose false-alarm rate holds for the whole flight.",
        "detect --follow: log10_e",
        also=("e-value", "SPRT"),
    ),
    _E(
        "smallest detectable change",
        "Change of a parameter that a window would have shown with the probability of --power.",
        "detect --detectable, --must-show",
        "of the parameter",
        ("minimum detectable change",),
    ),
    _E(
        "smearing",
        "False distribution of one real change over several parameters by least squares. A search over sets avoids it.",
        "isolate",
    ),
    _E(
        "station",
        "Numbered place in the gas path (ARP755): 2 inlet, 3 compressor exit, 4 burner exit, 45 between the turbines.",
        "columns: T3_K, P25_Pa",
    ),
    _E(
        "stuck sensor",
        "Sensor that repeats one value. Its readings are excluded and reported.",
        "check, detect, isolate",
        also=("frozen",),
    ),
    _E(
        "sufficient statistics",
        "Numbers to which a window is reduced without loss for the tests: s, F and V.",
        "residual",
    ),
    _E(
        "surge margin",
        "Distance of the operating point of a compressor from its surge line.",
        "engine outputs",
        "1",
    ),
    _E(
        "thrust or power at equal",
        "Comparison of engines at the same thrust or shaft power, so that temperature and fuel show health alone.",
        "work scope, trend --event",
        also=("at equal thrust",),
    ),
    _E(
        "trend shift",
        "Sudden change of a delta between flights, in contrast to gradual deterioration.",
        "trend: kind step",
        also=("step change",),
    ),
    _E(
        "turbine temperature",
        "Gas temperature measured at or behind the turbine: EGT, ITT or MGT, depending on the engine.",
        "T45_K, T5_K and the like",
        "K",
        ("EGT", "ITT", "MGT", "TGT"),
    ),
    _E(
        "verdict",
        "Result of a test: healthy, fault, or no verdict with its reason. No verdict never means healthy.",
        "detect, isolate, fleet",
    ),
    _E(
        "water wash",
        "Cleaning of the compressor, which restores part of its flow and efficiency.",
        "trend --events, fleet files",
        also=("compressor wash",),
    ),
    _E(
        "window",
        "Group of consecutive records that is judged together: a flight, a number of records, or a time.",
        "--window, --step",
        "records or s",
    ),
    _E(
        "work scope",
        "Modules to restore in a shop visit, with the turbine temperature and fuel that each would regain.",
        "isolate, trend: work_scope",
        "K, %",
        ("borescope", "shop visit"),
    ),
)
"""In alphabetical order."""


def search(word: str) -> list[GlossaryEntry]:
    """The entries of a word: those that have it as a word, else those that contain it, else the nearest."""
    from difflib import get_close_matches

    asked = word.casefold().strip()
    names = {name.casefold(): entry for entry in GLOSSARY for name in (*reversed(entry.also), entry.word)}
    if asked in names:
        return [names[asked]]
    near = [name for name in names if asked in name] if len(asked) > 1 else []
    return list(dict.fromkeys(names[name] for name in near or get_close_matches(asked, names)))


def as_text(entries: Sequence[GlossaryEntry]) -> str:
    """Entries for a terminal."""
    from textwrap import fill

    parts = []
    for entry in entries:
        also = f" (also: {', '.join(entry.also)})" if entry.also else ""
        unit = f" Unit: {entry.unit}." if entry.unit else ""
        text = f"{entry.meaning}{unit} Used in: {entry.used}."
        indent = "    "
        parts.append(f"{entry.word}{also}\n{fill(text, LINE, initial_indent=indent, subsequent_indent=indent)}\n")
    return "\n".join(parts)


def as_markdown(entries: Sequence[GlossaryEntry]) -> str:
    """Entries as a page of the documents."""
    lines = ["# Glossary", "", "| word | meaning | unit | used in |", "|---|---|---|---|"]
    for entry in entries:
        also = f"<br>({', '.join(entry.also)})" if entry.also else ""
        lines.append(f"| **{entry.word}**{also} | {entry.meaning} | {entry.unit} | {entry.used} |")
    return "\n".join(lines) + "\n"

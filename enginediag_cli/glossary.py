"""The words of the field that the program uses, each with its meaning, unit and place in the program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

LINE = 100
"""Characters of a line of the text on a terminal."""


class GlossaryEntry(NamedTuple):
    """A word: its meaning in one or two sentences, where the program uses it, its unit, and other words for it."""

    word: str
    meaning: str
    used: str
    unit: str = ""
    also: tuple[str, ...] = ()


TEXT = """
ambiguity group; alternative hypotheses; rivals
    Causes that the data cannot separate: each fits as well as the others. More sensors or other operating
    points may separate them.
    Used in: isolate, explain: rivals; locate: a = b
baseline
    Reference from which changes are counted: the nominal engine, or the first flights of an engine.
    Used in: detect --reference, trend --baseline, fleet
Bayesian model averaging; model averaging
    Estimate averaged over several possible explanations, each weighted with its posterior probability.
    Used in: isolate: column change; explain: averaged formulas
bleed
    Air taken from a compressor for cooling, customers or surge control.
    Used in: engine files; physics: customer_bleed, handling_bleed. Unit: share of flow
change detection; fault detection
    Test for a difference between recent data and the nominal state. It does not name the cause; isolation does.
    Used in: detect
component map; map; compressor map; turbine map
    Table or formula of a turbomachine: flow, pressure ratio and efficiency over corrected speed.
    Used in: engine files: map, table; components
corrected
    Referred to ISA sea level (288.15 K, 101325 Pa), so that points at different inlet conditions can be
    compared.
    Used in: component maps, drivers
covariance
    Joint uncertainty of several estimates. Identification stores that of the nominal parameters.
    Used in: nominal file; residual: nuisance columns
credible interval; confidence interval
    Interval that contains the true value with the stated posterior probability, 95 % unless stated otherwise.
    Used in: isolate, trend, explain: columns low and high. Unit: of the parameter
cross-validation
    Fit without a block of records, then predict this block. Its errors measure how well the model generalises.
    Used in: identify
delta; ΔEGT; ΔWf; ΔN2; residual
    Difference between a reading and the model's prediction at the same operating condition, such as ΔEGT, ΔWf,
    ΔN2.
    Used in: residual --what records. Unit: of the reading
detection delay
    Number of records between the onset of a change and the alarm.
    Used in: detect --follow. Unit: records or s
deterioration; wear; degradation
    Gradual loss of component health by wear, erosion and fouling.
    Used in: trend: kind deterioration; fleet. Unit: of the parameter per flight
driver
    Quantity on which an effect or a discrepancy depends, such as Mach number, altitude or hours in service.
    Used in: locate, explain: driver; --driver
dynamic effect; effect with memory
    Effect with memory: its size depends on the past, such as heat soak or a lagging probe.
    Used in: simulate, explain; physics
efficiency
    Isentropic efficiency of a compressor or turbine. As a health parameter it is a factor on the map, nominal
    1.
    Used in: hpc.efficiency and the like. Unit: 1
EGT margin; ITT margin; MGT margin; EGT margin used
    Distance of the turbine temperature from its limit at the rating on a standard hot day (takeoff of an airliner).
    Deterioration consumes it, maintenance restores part of it.
    Used in: trend --what margin, fleet, report. Unit: K
empirical correction; law; formula
    Formula for an effect that is not in the library, found from the data. An engine file can carry it as
    `law:`.
    Used in: explain: status law; refine
envelope
    Range of operating conditions covered by the healthy recordings. Outside it limits widen, because the model
    was not tested there.
    Used in: identify; detect: records outside; check -n
equal thrust or power; at equal thrust
    Comparison of engines at the same thrust or shaft power, so that temperature and fuel show health alone.
    Used in: work scope, trend --event
excluded data; masked
    Records or readings that are not used, each with its reason: unsteady, frozen, outlier, outside the
    envelope.
    Used in: all commands that read recordings; check
false discovery rate
    Expected share of healthy engines among those that are flagged.
    Used in: fleet: engines flagged, at most 5 %. Unit: 1
false-alarm rate; false alarm; significance level
    Probability that a healthy window, or with --follow a healthy flight, raises an alarm.
    Used in: detect --false-alarm. Unit: 1
fault catalogue
    Named faults as directions in parameter space, such as compressor fouling: efficiency and flow fall
    together.
    Used in: isolate --catalogue, simulate --fault
flow capacity
    Corrected flow that a compressor or turbine passes. As a health parameter it is a factor on the map, nominal
    1.
    Used in: hpt.flow_capacity and the like. Unit: 1
forecast; prognosis; remaining useful life
    Number of flights until the EGT margin is used up at the present rate, with an interval.
    Used in: trend --what margin, fleet. Unit: flights
GLR test; likelihood ratio
    Generalised likelihood ratio test: compares the best fit with a change to the fit without one.
    Used in: detect: statistic, threshold, p_value
gross error; outlier; spike
    Single reading far outside its noise, such as a spike. It is excluded from statistics and counted.
    Used in: residual, detect, check
health parameter
    Factor or offset on a component that is 1 or 0 for the nominal engine: efficiency, flow capacity, area.
    Used in: engine files: monitored parameters; isolate, trend. Unit: mostly 1
identifiability; not identifiable
    Whether the healthy recordings determine a parameter of the engine. The others keep their prior.
    Used in: identify: report
identification; calibration; adaptation
    Fit of engine parameters, sensor offsets and noise to healthy recordings of one engine.
    Used in: identify
isolability
    Whether the data can separate a change of one parameter from changes of others.
    Used in: isolate --advise
isolation; fault isolation; diagnosis
    Search for the parameters, sensors or components that changed, with sizes and probabilities.
    Used in: isolate
linearisation
    Replacement of the model near one point by its derivatives. --linearise chooses the point.
    Used in: detect, isolate, trend
local approach
    Statistical theory of small changes (Basseville, Benveniste): a window is reduced to a normal vector s with
    mean F·δ and covariance V, where δ is the change.
    Used in: residual; isolate --method incremental, sensitivity, minmax
map error; model error
    Error of the component maps, as a smooth function of their coordinates. It is identified with its
    uncertainty, and a deviation within it is no finding.
    Used in: identify, --model-error. Unit: relative
marginal likelihood; evidence; Bayes factor
    Probability of the data under a hypothesis, averaged over its unknown sizes. It rewards fit and punishes
    freedom.
    Used in: isolate, explain
model inadequacy; discrepancy; mismatch; missing physics
    Systematic difference between model and engine that no parameter explains.
    Used in: locate, explain; column fit
module; component
    Part of an engine that is removed and repaired as a whole: fan, HPC, HPT and so on.
    Used in: isolate --by component, work scope
monitored parameter
    Parameter that a test may report as changed.
    Used in: engine files; --monitor
nominal file; nominal engine; nominal state
    YAML file with the identified state of one healthy engine: parameters, covariance, noise, envelope and the
    engine itself.
    Used in: identify -o; -n in other commands
nuisance parameter
    Unknown that is not of interest but affects the readings, such as a sensor offset. It is integrated out.
    Used in: residual: nuisance columns
observability; excitation
    Whether the sensors show a change of a parameter at all. A window says which parameters it does not excite.
    Used in: detect --detectable, isolate
onset
    Record or flight at which a change began.
    Used in: trend, detect --follow. Unit: flight or s
p value
    Probability of a statistic at least this large if nothing has changed. Below the false-alarm rate it is an
    alarm.
    Used in: detect, locate. Unit: 1
posterior probability
    Probability of a hypothesis after the data, from prior and marginal likelihood.
    Used in: isolate, explain, trend: probability. Unit: 1
power; probability of detection
    Probability that a test detects a change of a given size. Of an engine: its shaft power or power setting.
    Used in: detect --power. Unit: 1
prior
    What is assumed before the data: the probability that something changed, and its plausible size.
    Used in: isolate --inclusion, --sensor-inclusion; engine files: prior_sigma
recorder
    Description of a foreign recording: its columns, units and time stamps, as a YAML file.
    Used in: recorder, --recorder
reduced χ²; chi-squared; goodness of fit; lack of fit
    χ² per degree of freedom of what the answer leaves unexplained: near 1 when model and noise are right.
    Used in: column fit. Unit: 1
Reynolds index
    Reynolds number relative to sea level. At low values, high altitude, component efficiencies fall.
    Used in: drivers; physics: reynolds_efficiency. Unit: 1
sensitivity of the conclusion; flips; robustness
    The smallest error of a sensor, input or map, or change of the prior, that would change the diagnosis.
    Used in: isolate --flips. Unit: of the input or in σ
sequential test; e-value; SPRT
    Test after every block of records whose false-alarm rate holds for the whole flight.
    Used in: detect --follow: log10_e
smallest detectable change; minimum detectable change
    Change of a parameter that a window would have shown with the probability of --power.
    Used in: detect --detectable, --must-show. Unit: of the parameter
smearing
    False distribution of one real change over several parameters by least squares. A search over sets avoids
    it.
    Used in: isolate
station
    Numbered place in the gas path (ARP755): 2 inlet, 3 compressor exit, 4 burner exit, 45 between the turbines.
    Used in: columns: T3_K, P25_Pa
stuck sensor; frozen
    Sensor that repeats one value. Its readings are excluded and reported.
    Used in: check, detect, isolate
sufficient statistics
    Numbers to which a window is reduced without loss for the tests: s, F and V.
    Used in: residual
surge margin
    Distance of the operating point of a compressor from its surge line.
    Used in: engine outputs. Unit: 1
trend shift; step change
    Sudden change of a delta between flights, in contrast to gradual deterioration.
    Used in: trend: kind step
turbine temperature; EGT; ITT; MGT; TGT
    Gas temperature measured at or behind the turbine: EGT, ITT or MGT, depending on the engine.
    Used in: T45_K, T5_K and the like. Unit: K
verdict
    Result of a test: healthy, fault, or no verdict with its reason. No verdict never means healthy.
    Used in: detect, isolate, fleet
water wash; compressor wash
    Cleaning of the compressor, which restores part of its flow and efficiency.
    Used in: trend --events, fleet files
window
    Group of consecutive records that is judged together: a flight, a number of records, or a time.
    Used in: --window, --step. Unit: records or s
work scope; borescope; shop visit
    Modules to restore in a shop visit, with the turbine temperature and fuel that each would regain.
    Used in: isolate, trend: work_scope. Unit: K, %
"""
"""In alphabetical order: a word, and behind semicolons other words for it; below it one or two sentences, and where the
program uses it, with its unit."""


def _read(text: str) -> tuple[GlossaryEntry, ...]:
    entries, blocks = [], text.strip().replace("\n    ", "\t").split("\n")
    for block in blocks:
        head, *lines, last = block.split("\t")
        word, *also = head.split("; ")
        used, _, unit = last.removeprefix("Used in: ").partition(". Unit: ")
        entries.append(GlossaryEntry(word, " ".join(lines), used, unit, tuple(also)))
    return tuple(entries)


GLOSSARY = _read(TEXT)


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

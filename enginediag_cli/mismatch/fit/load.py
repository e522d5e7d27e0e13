"""Evidence out of files: an engine, recordings of one engine or of a fleet, and perhaps a nominal state.

What is identified along with an effect (the nuisance), and how loosely, is decided here, in this order:

- names: the `nuisance:` of the engine file's `mismatch:` block; else what `identification:` lists, less what it
  fixes; else the monitored health parameters and the scale errors of the recorded sensors;
- standard deviations of the priors: `mismatch: prior_sigma:`, then `identification: prior_sigma:`, then the
  parameter's own, but 0.2 % for a sensor's scale error that was not asked for by name: one of 1 % would swallow
  most of what is looked for;
- where a nominal state is given, its parameters are where priors are centred, what is not nuisance is held there,
  and noise is what it says, to be estimated anew where it is what that fit left, since that holds the mismatch too,
  but not where it is what cross-validation left, which is the model's error on readings that it has not seen;
- offsets of instruments that identification has found between recordings are allowed for in each recording;
- where none is given, an engine that has an `identification:` block is identified on all flights first, none of which
  is taken for clean (`self_identified`); priors stay where the engine file has them (`stated_priors`).
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.engine.declaration import MISMATCH
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.error_model.maps import stated_map_accuracy
from enginediag_cli.errors import DataError
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.identification.nominal_checks import set_map_accuracy
from enginediag_cli.identification.problem import IdentificationSettings, OffsetPrior, settings_from_mapping
from enginediag_cli.intake.agreement import check_against_engine, check_against_nominal
from enginediag_cli.intake.loader import GrossCounts, RecordingLoader, Thinning, load_flights
from enginediag_cli.intake.selection import NominalBaseline, RecordingSource, open_baseline, required_columns
from enginediag_cli.mismatch.controlled.find import ControlSearchResult, find_law
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise, Owed, Settings, as_recordings
from enginediag_cli.mismatch.fit.noise import larger_noise
from enginediag_cli.mismatch.fit.nuisance import amounts_of
from enginediag_cli.mismatch.fit.self_identified import SelfIdentified, left_by_the_fit, self_identified
from enginediag_cli.mismatch.fit.share import share_of
from enginediag_cli.mismatch.fit.stated_priors import with_stated_priors
from enginediag_cli.residuals.gross_gate import gross_of_flight
from enginediag_cli.residuals.instruments import NoiseModel

MOST_SEARCHED = 160_000
"""Records that are searched at most, some 4 kB of each: 200 flights of an airliner once in ten seconds, of which a
search takes 1.1 GB. More of the same flights say little more."""
SCALE_SIGMA = 0.002
"""Prior standard deviation of a recorded sensor's scale error that nobody states."""


@dataclass(frozen=True)
class MismatchQuery:
    """Choices of the user. `model_error`: relative accuracy of the maps, None for the engine file's; `drivers`:
    further recorded columns that may drive an effect; `noise`: "specified" or "estimate", None for the engine file's
    choice."""

    model_error: float | None = None
    false_alarm: float = 0.05
    drivers: tuple[str, ...] = ()
    noise: str | None = None
    seed: int = 0

    @property
    def vouched(self) -> bool:
        """Whether somebody states both the noise and what maps err by."""
        return self.noise == "specified" and self.model_error is not None


@dataclass(frozen=True)
class RecordedCase:
    """What a user asks about: an engine file, recordings, perhaps a nominal file; `accept_changed_engine`: go on
    although the engine file is not the one that was identified."""

    engine: str
    source: RecordingSource
    nominal: str | None = None
    accept_changed_engine: bool = False
    asked: MismatchQuery = field(default_factory=MismatchQuery)


@dataclass(frozen=True)
class LoadedCase:
    """The evidence, the intake that it came through, which knows what was left out, and the nominal state, if any.
    `control`: the control that the engine of the file lacks and that of the evidence has, None without one;
    `as_described`: the engine without it, and its description, where one was sought; `thinning`: how many of the
    records were kept."""

    evidence: Dataset
    intake: RecordingLoader
    baseline: NominalBaseline | None = None
    control: ControlSearchResult | None = None
    as_described: tuple[EngineDescription, Engine] | None = None
    thinning: Thinning = field(default_factory=Thinning)


def load_case(
    case: RecordedCase,
    fitted: Callable[[Sequence[Flight]], list[Flight]] = list,
    *,
    identified: bool = False,
    controls: bool = False,
) -> LoadedCase:
    """Read everything that a case names. `fitted`: of all flights those by which an engine may be identified, where
    that must be done first. `identified`: what instruments, maps and noise err by is to come from the flights, too,
    where nobody vouches for the noise; of long recordings a share tells it. `controls`: a control that the engine lacks
    is sought first, since nothing can be fitted without it. Who states both the noise and what maps err by is believed:
    nothing is identified first, since what the flights hold would be taken for an instrument's offsets and a map's
    errors. Raises ConfigError and DataError for files and names that do not fit.
    """
    from enginediag_cli.physics.engine_file import load_engine

    baseline = None
    if case.nominal:
        baseline = open_baseline(case.nominal, case.engine, accept_changed_engine=case.accept_changed_engine)
    engine = baseline.engine if baseline else load_engine(case.engine)
    gated = case.source.recorder is not None and RecordingLoader(case.source, None).make_ungated() is not None
    # what moves is looked for where it was recorded: a gate has left it out
    past = not gated
    agreement = check_against_nominal(engine, baseline.nominal) if baseline else check_against_engine(engine)
    wanted = required_columns(engine, others=case.asked.drivers, past=past)
    intake = RecordingLoader(case.source, wanted, fleet=True, agreement=agreement)
    thinning = Thinning(MOST_SEARCHED)
    whole = load_flights(intake, thinning)
    _known_drivers(case.asked.drivers, intake.columns)
    flights = [Flight(f.recording.label, f.engine, f.recording.columns, f.file) for f in whole]
    healthy = share_of(fitted(flights)) if identified else fitted(flights)
    nominal: Nominal | SelfIdentified | None = baseline.nominal if baseline else None
    control: ControlSearchResult | None = None
    described: tuple[EngineDescription, Engine] | None = None
    if controls:
        described = _described(engine, baseline), engine
        control = find_law(*described, as_recordings(healthy))
        if control is not None:
            # a nominal state of the engine without it knows neither its noise nor its maps
            engine, nominal, baseline = control.best.engine, None, None
    if nominal is None and not case.asked.vouched and engine.declared.get("identification"):
        # an engine whose design is not known must be identified before anything can be missing
        nominal = self_identified(engine, healthy)
    evidence = build_dataset(engine, flights, case.asked, nominal=nominal)
    if baseline and engine.declared.get("identification"):
        # instruments differ from flight to flight by more than one flight's nominal knows
        own = build_dataset(engine, flights, case.asked, nominal=self_identified(engine, healthy))
        owed = Owed(evidence.noise, priors=False)
        instruments = evidence.settings.instruments or own.settings.instruments
        settings = replace(evidence.settings, instruments=instruments)
        evidence = replace(evidence, noise=larger_noise(evidence.noise, own.noise), settings=settings, owed=owed)
    elif nominal is not None:
        stated, settings = build_dataset(engine, flights, case.asked).noise, evidence.settings
        settings = with_stated_priors(settings, engine) if baseline is None else settings
        evidence = replace(evidence, settings=settings, owed=Owed(stated, priors=True))
    elif identified and case.asked.noise is None:
        own = build_dataset(engine, flights, case.asked, nominal=self_identified(engine, healthy))
        evidence = _with_errors_of(evidence, own)
    evidence, gross = without_gross_errors(evidence)
    for left in intake.excluded:
        left.gross = sum(
            (c for (file, name), c in gross.items() if file == left.file and left.engine in ("", name)), left.gross
        )
    return LoadedCase(evidence, intake, baseline, control, described, thinning)


def without_gross_errors(evidence: Dataset) -> tuple[Dataset, dict[tuple[str, str], GrossCounts]]:
    """The evidence with gross errors as missing readings, and what was rejected of each file and engine. Judged on the
    residual where priors have the engine; what the model lacks is no gross error, since it lasts or concerns several
    readings."""
    engine, noise = evidence.engine, evidence.noise
    flights, counts = [], dict[tuple[str, str], GrossCounts]()
    names = [n for n in evidence.settings.nuisance if n in engine.parameters]
    prior = {n: v for n, v in evidence.settings.prior_mean.items() if n in engine.parameters}
    precision = np.diag([evidence.settings.nuisance[n] ** -2.0 for n in names])
    for flight in evidence.flights:
        sensors = [s for s in noise.sigma if s in flight.columns]
        law = NoiseModel(
            np.array([noise.sigma[s] for s in sensors]), np.array([noise.rho.get(s, 0.0) for s in sensors])
        )
        found = gross_of_flight(engine, prior, flight.columns, tuple(names), precision, law, sensors)
        flights.append(replace(flight, columns={**flight.columns, **found.columns}) if found.columns else flight)
        place = flight.file, flight.engine
        counts[place] = counts.get(place, GrossCounts()) + found.counts
    return replace(evidence, flights=tuple(flights)), counts


def _described(engine: Engine, baseline: NominalBaseline | None) -> EngineDescription:
    """The engine's text: of the file that was named, or what travels in the nominal file."""
    if baseline is not None and baseline.nominal.description is not None:
        return baseline.nominal.description
    return EngineDescription.from_engine_file(engine.path, engine.declared)


def _with_errors_of(evidence: Dataset, own: Dataset) -> Dataset:
    """The evidence of an engine whose design is known, with noise, instruments and errors of maps as an identification
    of the same flights finds them. What the engine is expected to be stays as stated: priors about what the flights
    made of it would hold half of what is looked for."""
    found, noise = own.settings, evidence.noise
    settings = replace(evidence.settings, maps=found.maps, instruments=found.instruments, noise=found.noise)
    wider = larger_noise(replace(noise, rho={**own.noise.rho, **noise.rho}), own.noise)
    return replace(evidence, noise=wider, settings=settings, owed=Owed(noise, priors=False))


def build_dataset(
    engine: Engine,
    flights: Sequence[Flight],
    asked: MismatchQuery | None = None,
    *,
    nominal: Nominal | SelfIdentified | None = None,
) -> Dataset:
    """Evidence from flights that are in memory.

    Raises DataError for a name in the engine's settings, or a driver, that does not exist.
    """
    asked = asked or MismatchQuery()
    block: Mapping[str, Any] = engine.declared.get("mismatch") or {f.name: f.default for f in MISMATCH.fields}
    stated = settings_from_mapping(engine.declared.get("identification"))
    sensors = _sensors(engine, flights, stated)
    sigma = _prior_sigma(engine, block, stated, sensors)
    _check_limits(engine, block.get("limits") or {})
    known = nominal if isinstance(nominal, Nominal) else None
    maps = nominal.error_model if nominal is not None else None
    if known is not None and asked.model_error is not None:
        nominal = known = set_map_accuracy(known, asked.model_error)
        maps = known.error_model
    theta0 = nominal.engine_values if nominal is not None else dict(stated.prior_mean)
    theta0 = {n: v for n, v in theta0.items() if n in engine.parameters}
    unused = set(engine.sensors) - set(sensors)
    flights = [
        Flight(f.label, f.engine, {c: v for c, v in f.columns.items() if c not in unused}, f.file) for f in flights
    ]
    settings = Settings(
        sigma,
        prior_mean={n: v for n, v in theta0.items() if n in sigma} | (amounts_of(engine, known) if known else {}),
        maps=maps,
        map_accuracy=stated_map_accuracy(engine) if asked.model_error is None else asked.model_error,
        false_alarm=asked.false_alarm,
        loss=stated.loss if engine.declared.get("identification") else "none",
        loss_scale=stated.loss_scale,
        offsets={c: v for c, v in stated.recording_bias_sigma.items() if c in sensors},
        scale_offsets={c: v for c, v in stated.recording_scale_sigma.items() if c in sensors},
        instruments=_instruments(nominal, sensors, engine),
        noise=asked.noise or _noise_choice(block, sensors, nominal),
        seed=asked.seed,
    )
    held = {n: v for n, v in theta0.items() if n not in sigma}
    return Dataset(
        engine.replace_nominals(held),
        tuple(flights),
        _noise(engine, sensors, stated, nominal, block),
        settings,
        _drivers(asked.drivers, flights),
    )


def searched_again(evidence: Dataset, freed: Sequence[Flight]) -> Dataset:
    """The evidence with noise, and with priors where they are its own, as an identification of the same flights with
    other readings finds them."""
    assert evidence.owed is not None
    own, engine, least = self_identified(evidence.engine, freed), evidence.engine, evidence.owed.least
    noise = larger_noise(
        # what is stated says nothing of a correlation
        replace(least, rho={**own.rho1, **least.rho}),
        replace(least, sigma=dict(own.sigma), rho=dict(own.rho1), estimated=True),
    )
    settings = evidence.settings
    if evidence.owed.priors:
        amounts = amounts_of(engine, own) if isinstance(own, Nominal) else {}
        means = {n: v for n, v in own.engine_values.items() if n in settings.nuisance}
        instruments = _instruments(own, list(noise.sigma), engine)
        settings = replace(settings, prior_mean=means | amounts, maps=own.error_model, instruments=instruments)
        settings = with_stated_priors(settings, engine)
    return replace(evidence, noise=noise, settings=settings)


def _instruments(
    nominal: Nominal | SelfIdentified | None, sensors: Sequence[str], engine: Engine
) -> tuple[OffsetPrior, ...]:
    """Offsets between recordings that a nominal state has found, of the size of a further recording's; those stated of
    inputs, too, which settings do not hold."""
    if not isinstance(nominal, Nominal):
        return ()
    found = [o for o in nominal.offsets if o.sensor in engine.inputs or (o.recordings and o.sensor in sensors)]
    return tuple(replace(o, prior_sigma=o.next_sigma) for o in found)


def _sensors(engine: Engine, flights: Sequence[Flight], stated: IdentificationSettings) -> list[str]:
    """Sensors that are recorded and that identification uses."""
    allowed = list(engine.sensors)
    if stated.sensors:
        allowed = [s for s in allowed if any(fnmatch.fnmatch(s, p) for p in stated.sensors)]
    found = [s for s in allowed if any(s in f.columns and np.isfinite(f.columns[s]).any() for f in flights)]
    if not found:
        raise DataError(f"the recordings hold no reading of any sensor of the engine ({', '.join(allowed)})")
    return found


def _prior_sigma(
    engine: Engine, block: Mapping[str, Any], stated: IdentificationSettings, sensors: Sequence[str]
) -> dict[str, float]:
    """Nuisance parameter → standard deviation of its prior, in the order of the engine's parameters."""
    errors = {p.name: p for s in sensors for p in engine.sensors[s].parameters()}
    names = [n for n, p in engine.parameters.items() if not p.belongs_to_sensor or n in errors]
    scales = [n for n, p in errors.items() if p.quantity == "scale"]
    if block["nuisance"]:
        wanted = _matched(engine, block["nuisance"], "mismatch: nuisance")
    elif stated.parameters:
        fixed = set(_matched(engine, stated.fixed, "identification: fixed"))
        wanted = [n for n in _matched(engine, stated.parameters, "identification: parameters") if n not in fixed]
    else:
        fixed = set(_matched(engine, stated.fixed, "identification: fixed"))
        wanted = [n for n in (*engine.monitored, *scales) if n not in fixed]
    _matched(engine, [*block["prior_sigma"], *stated.prior_sigma], "prior_sigma")
    own = {n: engine.parameters[n].prior_sigma for n in names}
    if not stated.parameters:
        own |= dict.fromkeys(scales, SCALE_SIGMA)
    sigma = {**own, **stated.prior_sigma, **block["prior_sigma"]}
    return {n: float(sigma[n]) for n in names if n in set(wanted)}


def _matched(engine: Engine, patterns: Sequence[str], where: str) -> list[str]:
    found: list[str] = []
    for pattern in patterns:
        hits = fnmatch.filter(engine.parameters, pattern)
        if not hits:
            raise DataError(
                f"{engine.path}: `{where}` names an unknown parameter '{pattern}' ({near(pattern, engine.parameters)})"
            )
        found += hits
    return list(dict.fromkeys(found))


def _check_limits(engine: Engine, limits: Mapping[str, float]) -> None:
    """Raises DataError for a limit of something that is no coefficient of an effect of this engine, or one that would
    forbid the effect's absence."""
    from enginediag_cli.physics.registry import candidate_effects

    known = {
        e.parameter_name(c.name): c for e in (*engine.effects, *candidate_effects(engine)) for c in e.term.COEFFICIENTS
    }
    for name, value in limits.items():
        if name not in known:
            raise DataError(
                f"{engine.path}: `mismatch: limits` names an unknown coefficient '{name}' ({near(name, known)})"
            )
        if value < known[name].absent:
            raise DataError(
                f"{engine.path}: `mismatch: limits: {name}` is below {known[name].absent:g}, the value "
                "without the effect"
            )


def _noise(
    engine: Engine,
    sensors: Sequence[str],
    stated: IdentificationSettings,
    nominal: Nominal | SelfIdentified | None,
    block: Mapping[str, Any],
) -> Noise:
    sigma = {s: stated.noise_sigma.get(s) or engine.sensors[s].noise_sigma for s in sensors}
    inputs, shares = dict(block.get("input_noise") or {}), dict(block.get("input_noise_share") or {})
    for name in (*inputs, *shares):
        if name not in engine.inputs:
            raise DataError(
                f"{engine.path}: `mismatch:` states noise of '{name}', which is not an input "
                f"({near(name, engine.inputs)})"
            )
    if nominal is None:
        return Noise(sigma, {}, inputs, shares)
    rho = {s: nominal.rho1.get(s, 0.0) for s in sensors}
    estimated = isinstance(nominal, SelfIdentified) or any(
        n.sigma_from != "stated" for n in nominal.noise if n.sensor in sensors
    )
    return Noise({s: nominal.sigma.get(s, v) for s, v in sigma.items()}, rho, inputs, shares, estimated)


def _noise_choice(block: Mapping[str, Any], sensors: Sequence[str], nominal: Nominal | SelfIdentified | None) -> str:
    if nominal is not None and left_by_the_fit(nominal, sensors):
        return "estimate"
    return "specified" if isinstance(nominal, SelfIdentified) else str(block["noise"])


def _drivers(names: Sequence[str], flights: Sequence[Flight]) -> tuple[str, ...]:
    """The further drivers, each of which some flight must have as numbers."""
    _known_drivers(names, list(dict.fromkeys(c for f in flights for c in f.columns)))
    return tuple(names)


def _known_drivers(names: Sequence[str], columns: Sequence[str]) -> None:
    for name in names:
        if name not in columns:
            raise DataError(f"no recording has numbers in a column '{name}' ({near(name, columns)})")

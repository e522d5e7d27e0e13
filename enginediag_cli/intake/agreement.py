"""Whether a recording can be of an engine at all, and in these units, decided before anything is fitted or judged.

A bounded sample of every flight is compared with the engine. Flights that are as near as engines of the kind are to
each other end the matter. Otherwise the misfit with all that may differ is found (comparison.py); where an engine of
the kind within its priors explains the recording, that is the explanation. Else a mistake is named that makes recording
and engine agree (mistakes.py) where it is likelier than the recording as read by NAMED and a share of what the readings
that it changes still lack, and no other mistake is as likely. What a model misses in a right file counts on both sides.
A misfit that no single mistake explains, nor a fault of the engine or of one instrument, is a wrong file as well: of
another engine, or with several mistakes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.intake.comparison import (
    INDEPENDENT,
    Columns,
    EngineReference,
    Misfit,
    engine_reference,
    nominal_reference,
)
from enginediag_cli.recordings.table import FlightNumbers

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.identification.nominal import Nominal
    from enginediag_cli.intake.mistakes import Mistake, MistakeTrial, RecordingOrigin
    from enginediag_cli.recordings.recorder import Recorder
    from enginediag_cli.recordings.table import Recording

POOLED, PER_FLIGHT, SAMPLED = 24, 6, 1000
"""Records of a sample that is compared with all that may differ; of one flight where there are several; and of all the
flights that are read at once."""
FEWEST = 3
"""Records below which nothing is said: one or two may be gross errors."""
NEAR = 0.015
"""Deviation of every sensor's median from an identified engine up to which a flight is not looked at more closely: a
mistake that changes less is indistinguishable from wear."""
NEAR_GENERIC = 0.05
"""The same for flights of an engine that is not identified, from the fit to all of them: as far as maps are wrong."""
ORDINARY = 1e-4
"""Share of engines of the kind, rightly recorded, that are as far from the model, below which a recording that nobody
looks into is said to be far from the engine."""
WRONG = 0.01
"""Share of recordings that come with a mistake, or with the file of another engine: one in a hundred. Judgement."""
TRIED = 100
"""Mistakes that are tried, about; each has its share of what is wrong."""
NAMED = float(-np.log(WRONG / TRIED))
"""Log-likelihood ratio of a mistake against the recording as it was read, from which it is likelier than that."""
ODDS_OF_THE_REST, ODDS_OF_A_FACTOR = 0.3, 1.0
"""Further log odds that are needed for each that is lacking with the mistake put right in the readings that it changes,
of a mistake (against the file as it was read, and against another mistake) and of a factor that no unit explains: where
a model does not follow a right file, changes that are none of its mistakes bring a little."""
APART = 2.0
"""Log odds by which a mistake must be likelier than the next that would change the recording otherwise: 7 to 1."""
SHOWN = 2
"""Names of one change of a column that are shown; of changes that cannot be separated all are."""
ALIKE = 0.03
"""Relative difference of the changed columns up to which two mistakes are the same change under two names: units a few
per cent apart (bar and atm) are one."""
FITS = 2.0
"""−ln p per independent reading up to which a flight, or another engine, fits as right files do: seven times what noise
and repeatability allow, the misfit of right recordings with generic maps."""
WORLDS_APART = 0.25
"""Root mean square of the deviations that are left with all that engines differ by, the worst sensor left aside, from
which a recording is of another engine or in other units although no single mistake says which. A plant whose guide
vanes the model lacks is at 0.15."""
COMPUTED = 0.5
"""Share of records without a prediction that no envelope and no fault explains."""


@dataclass(frozen=True)
class RecordingMismatch:
    """A recording, or a stretch of flights of it, that cannot be of this engine or in these units. flights: first and
    last label of the stretch, () where all records are in it; lines: of its first and last record compared. trial: the
    mistake that explains it, None where none does or several do, which `others` then names; searched: whether one was
    looked for."""

    source: str
    engine: str
    flights: tuple[str, ...]
    lines: tuple[int, int]
    as_read: Misfit
    trial: MistakeTrial | None = None
    others: tuple[str, ...] = ()
    searched: bool = True

    @property
    def place(self) -> str:
        """The recording, and since which flight."""
        found = self.source + (f", engine {self.engine}" if self.engine else "")
        return found + (f", {self.stretch}" if self.stretch else "")

    @property
    def stretch(self) -> str:
        """The flights that it is about, in words; "" for all."""
        if not self.flights:
            return ""
        first, last = self.flights[0], self.flights[-1]
        return f"flight {first}" if first == last else f"flights {first} to {last}"

    @property
    def wrong_file(self) -> float:
        """Probability that the recording is of another engine, or not in these units, against an engine as worn or
        damaged as engines are and one instrument that has failed by any amount."""
        return WRONG / (WRONG + (1.0 - WRONG) * self.as_read.tail_but_worst)

    @property
    def is_likely_wrong(self) -> bool:
        """Whether the recording is likelier wrong than the engine."""
        return self.wrong_file > 0.5

    def concerns(self, source: str, flight: str, engine: str) -> bool:
        """Whether a flight of an engine in a recording is part of it."""
        own = self.source == source and self.engine in ("", engine)
        return own and (not self.flights or flight in self.flights)

    @property
    def description(self) -> str:
        """What is wrong, with both misfits."""
        as_read = self.as_read
        far = describe_worst(as_read)
        if as_read.computed < COMPUTED:
            read = f"the model computes {as_read.computed:.0%} of the records as they are read"
        else:
            read = f"as read, readings and model are {far} apart"
        if not self.searched:
            return f"{read}, farther than engines of the kind are"
        if self.trial is None:
            said = f"this cannot be this engine or these units: {read}, whatever a fault may explain"
            if self.others:
                said += f"; several single mistakes would explain it: {'; '.join(self.others)}"
            return said
        if self.trial.mistake.kind == "engine":
            fits = "with that engine"
        else:
            fits = "put right"
        return f"{self.trial.mistake.words}: {read}; {fits}, {describe_worst(self.trial.misfit)}"

    @property
    def hint(self) -> str:
        """How to put it right."""
        return self.trial.mistake.hint if self.trial is not None else ""

    def __str__(self) -> str:
        return f"{self.place}: {self.description}" + (f" ({self.hint})" if self.hint else "")


def describe_worst(misfit: Misfit) -> str:
    """The largest deviation of a sensor's median, and the typical one, in words."""
    if not len(misfit.before):
        return "nothing to compare"
    size = np.expm1(np.abs(misfit.before))
    k = int(np.nanargmax(size))
    typical = float(np.sqrt(np.nanmean(np.square(size))))
    return f"{format_deviation(typical)} ({misfit.sensors[k]} {format_deviation(float(size[k]))})"


def format_deviation(share: float) -> str:
    """A deviation in words: in % up to a factor of three."""
    return f"{100.0 * share:.2g} %" if share < 2.0 else f"a factor of {1.0 + share:.2g}"


class MismatchError(DataError):
    """A recording that cannot be of the engine that it is compared with, or in the units that it is said to be in."""

    def __init__(self, found: Sequence[RecordingMismatch]):
        self.found = tuple(found)
        lines = [str(one) for one in found]
        super().__init__("\n".join([*lines, "nothing was judged; --accept-mismatch goes on all the same"]))


class AgreementCheck:
    """What recordings are compared with before they are judged: a yardstick and the engine behind it."""

    def __init__(self, yardstick: EngineReference, engine: object):
        self.yardstick, self._engine = yardstick, engine

    def find_mismatches(
        self, recording: Recording, engine: str = "", recorder: Recorder | None = None, search: bool = True
    ) -> list[RecordingMismatch]:
        """Of records of the engine that the `recorder` which mapped them calls `engine`; none where they agree. search:
        look for the mistake, which takes seconds and decides whether a recording that is far from the engine can be
        of it; without it all that are farther than engines of the kind are reported as they are."""
        sample = _Sample.from_recording(recording, self.yardstick)
        if sample is None:
            return []
        named = recording.text.get("engine")
        place = (recording.source, engine or (named[0] if named and len(set(named)) == 1 else ""))
        origin = recorder, engine
        if self.yardstick.identified or not search:
            near = NEAR if self.yardstick.identified else NEAR_GENERIC
            return self._compare_flights(sample, self.yardstick, near, origin, place, search)
        pooled = sample.pool(np.ones(len(sample.flights), bool))
        misfit = self.yardstick.misfit(pooled, 3)
        found = self._judge(sample, np.ones(len(sample.flights), bool), misfit, origin, place)
        if found is None:
            own = self.yardstick.recentre(misfit.values)
            apart = self._compare_flights(sample, own, NEAR_GENERIC, origin, place) if len(sample.labels) > 1 else []
            # a fit to flights of which some are wrong lies between the two, and is near to neither
            between = not apart and misfit.missing >= NAMED
            return self._compare_by_fitting_flights(sample, origin, place) if between else apart
        if found.trial is None and (apart := self._compare_by_fitting_flights(sample, origin, place)):
            return apart
        return [found]

    def _compare_flights(
        self,
        sample: _Sample,
        yardstick: EngineReference,
        near: float,
        origin: tuple[Recorder | None, str],
        place: tuple[str, str],
        search: bool = True,
    ) -> list[RecordingMismatch]:
        far = sample.find_far_flights(yardstick, near)
        if not far.any():
            return []
        found = []
        for run in _flight_runs(far):
            rows = np.isin(sample.number, run)
            if rows.sum() < FEWEST:
                continue
            misfit = yardstick.misfit(sample.pool(rows), 3)
            one = self._judge(sample, rows, misfit, origin, place, yardstick, search)
            if one is not None:
                found.append(one)
        return found

    def _compare_by_fitting_flights(
        self, sample: _Sample, origin: tuple[Recorder | None, str], place: tuple[str, str]
    ) -> list[RecordingMismatch]:
        """Flights that fit by themselves show which of the others do not."""
        numbers = range(len(sample.labels))
        if not 1 < len(sample.labels) <= PER_FLIGHT * PER_FLIGHT:
            return []
        single = [self.yardstick.misfit(sample.pool(sample.number == k), 1) for k in numbers]
        right = np.array([_is_fitting(m) for m in single])
        if not right.any() or right.all():
            return []
        own = self.yardstick.misfit(sample.pool(np.isin(sample.number, np.flatnonzero(right))), 3)
        return self._compare_flights(sample, self.yardstick.recentre(own.values), NEAR_GENERIC, origin, place)

    def _judge(
        self,
        sample: _Sample,
        rows: np.ndarray,
        as_read: Misfit,
        origin: tuple[Recorder | None, str],
        place: tuple[str, str],
        yardstick: EngineReference | None = None,
        search: bool = True,
    ) -> RecordingMismatch | None:
        """The disagreement of the records (K,) of a sample; None where they agree."""
        if as_read.missing < NAMED or not (search or as_read.tail < ORDINARY):
            return None
        yardstick = yardstick or self.yardstick
        columns = sample.pool(rows)
        labels = [sample.labels[k] for k in dict.fromkeys(sample.number[rows].tolist())]
        whole = len(labels) == len(sample.labels)
        lines = sample.line[rows]
        shown = RecordingMismatch(*place, () if whole else tuple(labels), (int(lines.min()), int(lines.max())), as_read)
        if not search:
            return replace(shown, searched=False)
        from enginediag_cli.intake.mistakes import (  # right recordings need none
            RecordingOrigin,
            try_factors,
            try_mistakes,
        )

        behind = RecordingOrigin(self._engine, *origin)
        best, others = _choose_mistake(try_mistakes(yardstick, behind, columns, as_read), behind, columns)
        if (best is None and not others) or (best is not None and -best.misfit.log_likelihood > NAMED):
            factor = try_factors(yardstick, behind, columns, as_read)
            if factor is not None and _is_sufficient(factor, ODDS_OF_A_FACTOR):
                if best is None or factor.gain >= best.gain + _required_gain(best, APART, ODDS_OF_A_FACTOR):
                    best = factor
        if best is not None:
            return replace(shown, trial=best)
        if others:  # each is likely enough to be named, so that the recording as it was read is not
            return replace(shown, others=tuple(m.words for m in others))
        if _is_another_engine(as_read) and whole:
            return replace(shown, trial=_find_other_engine(behind, columns, as_read))
        return None


def _find_other_engine(origin: RecordingOrigin, columns: Columns, as_read: Misfit) -> MistakeTrial | None:
    """The shipped engine that it is of, if one alone fits it as right files fit."""
    from enginediag_cli.intake.mistakes import MistakeTrial, compare_other_engines

    fitting = [(m, misfit) for m, misfit in compare_other_engines(origin, columns, as_read) if _is_fitting(misfit)]
    fitting.sort(key=lambda one: -one[1].log_likelihood)
    if not fitting or (len(fitting) > 1 and fitting[1][1].log_likelihood > fitting[0][1].log_likelihood - APART):
        return None
    mistake, misfit = fitting[0]
    return MistakeTrial.from_misfits(mistake, misfit, as_read)


def _choose_mistake(
    tried: Sequence[MistakeTrial], origin: RecordingOrigin, columns: Columns
) -> tuple[MistakeTrial | None, list[Mistake]]:
    """The mistake to be named, with what else would be the same change, or those between which nothing decides."""
    able = [t for t in tried if _is_sufficient(t, ODDS_OF_THE_REST)]
    if not able:
        return None, []
    best = able[0]
    changed = origin.derived(columns, best.mistake.change(columns))
    # what is likelier still, but not by enough to be named, is not excluded either
    close = [t.mistake for t in tried if t.gain > best.gain or (t in able[1:] and _is_close(t, best))]
    same = [m for m in close if _is_same_change(changed, origin.derived(columns, m.change(columns)))]
    rivals = [m for m in close if m not in same]
    if any(m.column != best.mistake.column or m.kind == "swapped" for m in rivals):
        return None, [best.mistake, *rivals]
    names = [best.mistake, *rivals, *same[: max(0, SHOWN - 1 - len(rivals))]]
    words = " or ".join([names[0].words, *(m.words.removeprefix(origin.name(m.column) + " ") for m in names[1:])])
    hint = ", or ".join(dict.fromkeys(m.hint for m in (best.mistake, *rivals)))
    return replace(best, mistake=replace(best.mistake, words=words, hint=hint)), []


def _is_close(trial: MistakeTrial, best: MistakeTrial) -> bool:
    """Whether the likeliest mistake is not likelier than another by what counts; a column may be misfitted by the
    model as much as either leaves it."""
    rest = max(best.rest, trial.rest) if trial.mistake.column == best.mistake.column else best.rest
    return trial.gain > best.gain - APART - ODDS_OF_THE_REST * rest


def _is_same_change(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> bool:
    """Whether two mistakes change the columns alike."""
    for column, values in one.items():
        if column in other and not np.array_equal(values, other[column]):
            size = np.nanmedian(np.abs(values))
            if not np.nanmedian(np.abs(values - other[column])) <= ALIKE * size:
                return False
    return True


def _required_gain(trial: MistakeTrial, odds: float, share: float = ODDS_OF_THE_REST) -> float:
    """Log odds, and a share of what the readings that a mistake changes lack with it put right."""
    return odds + share * trial.rest


def _is_sufficient(trial: MistakeTrial, share: float) -> bool:
    """Whether a mistake brings enough to be named, and the file, with it put right, can be of this engine."""
    return trial.gain >= _required_gain(trial, NAMED, share) and not _is_another_engine(trial.misfit)


def _is_fitting(misfit: Misfit) -> bool:
    """Whether a right file is misfitted by so much."""
    readings = INDEPENDENT * len(misfit.factor)
    return readings > 0 and misfit.computed >= COMPUTED and -misfit.log_likelihood <= FITS * readings


def _is_another_engine(misfit: Misfit) -> bool:
    """Whether no fault makes this: all but the worst sensor far from the model, or no model at all."""
    if misfit.computed < COMPUTED:
        return True
    order = np.argsort(misfit.factor)[:-1]
    if len(order) < 2:
        return False
    return float(np.sqrt(np.mean(misfit.after[order] ** 2))) >= WORLDS_APART


def _flight_runs(far: np.ndarray) -> Iterator[np.ndarray]:
    """Numbers of the flights that are compared together: all where most are far, else each stretch of them."""
    if np.mean(far) >= 0.8:
        yield np.arange(len(far))
        return
    edges = np.flatnonzero(np.diff(np.r_[False, far, False].astype(np.int8)))
    pairs = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    for first, end in sorted(pairs, key=lambda p: p[0] - p[1])[:MOST_RUNS]:
        yield np.arange(first, end)


MOST_RUNS = 4
"""Stretches of flights, the longest, that are looked at: a mistake lasts."""


@dataclass(frozen=True)
class _Sample:
    """Records chosen from those that hold all inputs and a reading: columns, `number` of the flight of each, the
    flights' labels and lines in the file. flights: as number, kept for its length."""

    columns: Mapping[str, np.ndarray]
    number: np.ndarray
    labels: tuple[str, ...]
    line: np.ndarray

    @property
    def flights(self) -> np.ndarray:
        return self.number

    @staticmethod
    def from_recording(recording: Recording, yardstick: EngineReference) -> _Sample | None:
        columns = {c: np.asarray(v, float) for c, v in recording.columns.items()}
        inputs, sensors = yardstick.engine.inputs, [s for s in yardstick.sensors if s in columns]
        if not sensors or any(c not in columns for c in inputs) or not len(recording):
            return None
        there = np.all([np.isfinite(columns[c]) for c in inputs], axis=0)
        there &= np.isfinite(np.column_stack([columns[s] for s in sensors])).any(axis=1)
        if there.sum() < FEWEST:
            return None
        known = FlightNumbers()
        number = known.numbers(recording)
        rows = np.flatnonzero(there)
        met, place = np.unique(number[rows], return_inverse=True)
        each = POOLED if len(met) == 1 else max(1, min(PER_FLIGHT, SAMPLED // len(met)))
        flights = np.split(rows[np.argsort(place, kind="stable")], np.cumsum(np.bincount(place))[:-1])
        if len(flights) > SAMPLED:
            kept = np.unique(np.linspace(0, len(flights) - 1, SAMPLED).astype(int))
            flights, met = [flights[k] for k in kept], met[kept]
        chosen = [f[np.unique(np.linspace(0, len(f) - 1, min(each, len(f))).astype(int))] for f in flights]
        picked = np.concatenate(chosen)
        names = {n: key for key, n in known.known.items()}
        labels = tuple(next((part for part in names.get(int(n), ()) if part), "") for n in met)
        own = np.repeat(np.arange(len(chosen)), [len(c) for c in chosen])
        return _Sample({c: v[picked] for c, v in columns.items()}, own, labels, recording.line[picked])

    def pool(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """At most POOLED of the chosen records (K,), spread over them."""
        index = np.flatnonzero(rows)
        index = index[np.unique(np.linspace(0, len(index) - 1, min(POOLED, len(index))).astype(int))]
        return {c: v[index] for c, v in self.columns.items()}

    def find_far_flights(self, yardstick: EngineReference, near: float) -> np.ndarray:
        """Flights of which a sensor's median is farther from the engine than `near`, and than noise explains."""
        e, sigma = yardstick.deviations(self.columns)
        found = np.zeros(len(self.labels), bool)
        count = np.bincount(self.number, minlength=len(found))
        for j in range(e.shape[1]):
            order = np.lexsort((e[:, j], self.number))
            first = np.r_[0, np.cumsum(count)[:-1]]
            there = np.bincount(self.number, np.isfinite(e[:, j]), minlength=len(found)).astype(int)
            middle = e[order, j][first + np.maximum(there - 1, 0) // 2]
            allowed = np.maximum(near, BY_NOISE * sigma[order, j][first] / np.sqrt(np.maximum(there, 1)))
            found |= (there > 0) & (np.abs(middle) > allowed)
        return found


BY_NOISE = 4.0
"""Standard deviations of noise that one flight of a thousand has."""


def check_against_engine(engine: Engine) -> AgreementCheck | None:
    """With an engine as its file describes it; None for a model without an engine file. Raises DataError."""
    return AgreementCheck(engine_reference(engine), engine) if hasattr(engine, "network") else None


def check_against_nominal(engine: Engine, nominal: Nominal) -> AgreementCheck | None:
    """With an engine in its nominal state, as `check_against_engine`."""
    if not hasattr(engine, "network"):
        return None
    model = engine if nominal.error_model is None else nominal.error_model.wrap(engine)
    values = {n: v for n, v in nominal.theta0.items() if n in model.parameters}
    sigma = np.array(list(nominal.sigma.values()))
    return AgreementCheck(nominal_reference(model, values, nominal.sensors, sigma), model)

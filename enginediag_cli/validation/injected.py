"""Known physics in real recordings: an effect is put in, concealed, and searched; the untouched recording is the null.

The readings of the raw file are multiplied by the ratio of two predictions of a model, with the effect over without.
Everything else of the recording stays as it was: noise, instruments, all that the model lacks already. The file is
then read as any other, and searched with default options.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from enginediag_cli.discrepancy.answer import DiscrepancyAnswer
from enginediag_cli.discrepancy.explain import Searched, search_and_refit
from enginediag_cli.engine.engine import Engine
from enginediag_cli.intake.selection import RecordingSource, open_baseline
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.load import RecordedCase, load_case
from enginediag_cli.physics.registry import effect
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.recorder import Recorder
from enginediag_cli.recordings.recorder_file import load_recorder
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

LARGEST_RATIO = 2.0
"""A ratio of predictions beyond it is a failed prediction, not an effect; the reading stays as it is."""

HEADER = "| recording | answer | found | ln evidence | size | P(place) | group | scatter | CPU s |\n|" + 9 * "---|"
"""Of a table of trials; scatter: the largest noise of a sensor over what is stated."""

Amplitude = Callable[[Mapping[str, np.ndarray]], np.ndarray]
"""Amplitude in every record (N,) from the recording's columns."""


@dataclass(frozen=True)
class InjectedEffect:
    """An amplitude, in its parameter's unit, at a place. `term` and `site` of a listed effect, whose first coefficient
    it is, or `parameter` of the engine, to whose value it is added."""

    amplitude: Amplitude
    term: str = ""
    site: str = ""
    parameter: str = ""

    @property
    def place(self) -> str:
        """Name of the place, as an answer gives it."""
        return self.parameter or f"{self.term}@{self.site}"

    def ratio(self, engine: Engine, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Sensor → prediction with the effect over prediction without, (N,); 1 where there is no prediction."""
        a = self.amplitude(columns)
        name = self.parameter
        if self.term:
            own = effect(engine, self.term, self.site)
            engine, name = engine.replace_effects((*engine.effects, own)), own.amplitudes[0]
        absent = engine.parameters[name].nominal
        sensors = [s for s in engine.sensors if s in columns]
        given = {c: columns[c] for c in (*engine.inputs, *engine.optional_inputs) if c in columns}
        with_it, without = (engine.predict(given, {name: v}, sensors=sensors) for v in (absent + a, absent))
        good = with_it.ok & without.ok & (a != 0.0)
        with np.errstate(all="ignore"):
            found = np.where(good[:, None], with_it.y / without.y, 1.0)
        found = np.where(np.isfinite(found) & (np.abs(np.log(np.abs(found))) < np.log(LARGEST_RATIO)), found, 1.0)
        return dict(zip(sensors, found.T, strict=True))


@dataclass(frozen=True)
class RealCase:
    """A recording of a real engine: engine file, recorder, the engine of the aircraft, its nominal file; `files` that
    are searched together, of which the first is the one that an effect is put into."""

    engine: str
    files: tuple[str, ...]
    recorder: str | None = None
    engine_instance: str = ""
    nominal: str | None = None

    def load(self) -> Dataset:
        """As any command reads it."""
        source = RecordingSource(self.files, self.recorder, self.engine_instance)
        return load_case(RecordedCase(self.engine, source, self.nominal)).evidence

    def model(self) -> Engine:
        """The engine at its nominal state."""
        from enginediag_cli.physics.engine_file import load_engine

        if self.nominal is None:
            return load_engine(self.engine)
        baseline = open_baseline(self.nominal, self.engine)
        known = baseline.engine.parameters
        values = {n: v for n, v in baseline.nominal.engine_values.items() if n in known}
        return baseline.engine.replace_nominals(values)


def injected_file(case: RealCase, put_in: Sequence[InjectedEffect], folder: Path) -> RealCase:
    """The case with a copy of its first file in `folder`, which carries the effects in the readings of its engines."""
    path = Path(case.files[0])
    model = case.model()
    if case.recorder is None:
        raw = read_all(path)
        new = raw.with_columns(_scaled(raw.columns, [e.ratio(model, raw.columns) for e in put_in]))
    else:
        recorder = load_recorder(case.recorder)
        new = _into_raw(recorder, read_all(path), case, put_in, model)
    written = folder / path.name
    write_csv(written, [new])
    return replace(case, files=(str(written), *case.files[1:]))


def _scaled(columns: Mapping[str, np.ndarray], ratios: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Readings with all effects, by column."""
    found: dict[str, np.ndarray] = {}
    for ratio in ratios:
        for c, r in ratio.items():
            found[c] = found.get(c, columns[c]) * r
    return found


def _into_raw(
    recorder: Recorder, raw: Recording, case: RealCase, put_in: Sequence[InjectedEffect], model: Engine
) -> Recording:
    """The raw recording with the effects in the columns that the readings are made of, in their own units."""
    for mapped in recorder.map(raw, steady=False):
        if case.engine_instance not in ("", mapped.engine):
            continue
        own = recorder.engines[mapped.engine]
        ratios = [e.ratio(model, mapped.recording.columns) for e in put_in]
        at = np.searchsorted(raw.line, mapped.recording.line)
        for channel in recorder.channels:
            factors = [r[channel.target] for r in ratios if channel.target in r]
            if not factors:
                continue
            factor = np.ones(len(raw))
            factor[at] = np.prod(factors, axis=0)
            source, full = channel.source_column(own), own["full_scale"].get(channel.target)
            # what a channel reads is linear in the source
            zero, one = channel.read(np.array([0.0, 1.0]), full)
            offset = float(zero / (one - zero))
            raw = raw.with_columns({source: factor * (raw[source] + offset) - offset})
    return raw


def search_case(case: RealCase) -> Searched:
    """Search a recording with default options."""
    return search_and_refit(case.load())


def table_row(title: str, trial: Searched) -> str:
    """The row of a Markdown table under HEADER."""
    a: DiscrepancyAnswer = trial.answer
    what = "; ".join(f"{m.words}, {m.kind}" + (f" along {m.driver}" if m.driver else "") for m in a.members)
    sizes = "; ".join(f"{m.size:.3g} ± {m.standard_deviation:.2g}" for m in a.members)
    first = a.posterior.places.get(a.members[0].place, 0.0) if a.members else 0.0
    group = ", ".join(a.posterior.group) if a.found else ""
    cost = f"{trial.fit_s + trial.search_s + trial.refit_s:.0f}"
    cells = (what or "nothing", "yes" if a.found else "no", f"{a.evidence:.1f}", sizes, f"{first:.2f}", group)
    return "| " + " | ".join((title, *cells, f"{max(a.scatter.values()):.1f}", cost)) + " |"


def switched(size: float, intervals: Sequence[tuple[float, float]]) -> Amplitude:
    """An amplitude of this size within intervals of time, s."""

    def amplitude(columns: Mapping[str, np.ndarray]) -> np.ndarray:
        t = np.asarray(columns["time_s"], float)
        on = np.zeros(len(t), bool)
        for low, high in intervals:
            on |= (t >= low) & (t < high)
        return np.where(on, size, 0.0)

    return amplitude

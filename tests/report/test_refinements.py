"""Before and after in words and as a picture."""

from __future__ import annotations

from types import SimpleNamespace
from xml.dom import minidom

import numpy as np

from enginediag_cli.mismatch.refine.criteria import Prediction, Records, Significance
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.report.plotting.discrepancy import MOST_FLIGHTS, picture
from enginediag_cli.report.tables.identification import refinement_sentences
from enginediag_cli.shipped import shipped


def quality(sensor, unit, rms, chi2):
    return SimpleNamespace(sensor=sensor, unit=unit, rms=rms, chi2=chi2, n=100)


def refinement(gains, share=1.02):
    engine = load_engine(str(shipped("turbofan.yaml")))
    alarms = [
        SimpleNamespace(
            judged=20, alarms=a, rate=a / 20, interval=(0.0, 0.2), misfits=0, fit=1.0, reason="", without_verdict=0
        )
        for a in (4, 0)
    ]
    unseen = SimpleNamespace(
        quality_before=[quality("T3_K", "K", 1.72, 1.3), quality("P3_Pa", "%", 0.668, 1.1)],
        quality_after=[quality("T3_K", "K", 1.551, 1.0), quality("P3_Pa", "%", 0.6502, 0.98)],
        labels=[f"unseen.csv flight {k + 1}" for k in range(len(gains))],
        flight_gains=np.array(gains),
        flights_before=np.zeros(len(gains)),
        flights_after=np.array(gains),
        chi2_before=1.2,
        chi2_after=0.99,
        readings=200,
        lost=0,
        states=None,
        gain=sum(gains),
    )
    return SimpleNamespace(
        effects=(effect(engine, "power_offtake", "hp", {"fraction": 0.0104}),),
        standard_errors={"power_offtake.hp.fraction": 1e-3},
        unseen=unseen,
        criteria=(
            Significance("power_offtake@hp", 1, 108.0, 1.0, 100.0, 30.0),
            Prediction(Records.ALL, share, 400.0, 1.0, 0.05, 25.0, 3, 200),
        ),
        alarms_before=alarms[0],
        alarms_after=alarms[1],
        still_missing="",
        failed="",
    )


def words(text):
    return [t.firstChild.data for t in minidom.parseString(text).getElementsByTagName("text")]


def test_a_coefficient_is_told_with_its_interval_and_what_it_is():
    effects, fitted, *_ = refinement_sentences(refinement([5.0, 3.0]))
    assert effects == "Shaft power off-take at HP (power_offtake@hp):"
    assert fitted.startswith("  fraction = 0.010 ± 0.002 (95 %): load over")


def test_false_alarms_and_gains_are_told_with_how_many_were_judged():
    told = " ".join(refinement_sentences(refinement([5.0, -1.0])))
    assert "the readings ask for 1.02 ± 0.05 of the change that is predicted" in told and "log likelihood +4.0" in told
    assert "4 of 20 windows (20 %, 95 % interval 0 to 20 %) before, 0 of 20 windows" in told


def test_the_picture_gives_sensors_in_their_units_and_losses_a_sign():
    told = words(picture(refinement([5.0, -1.0])))
    assert {"T3_K", "1.72 → 1.55 K", "0.668 → 0.650 %", "+5.0", "−1.0"} <= set(told)


def test_more_flights_than_a_picture_holds_are_told_together():
    told = words(picture(refinement([2.0] * (MOST_FLIGHTS - 1) + [-1.0, 4.0])))
    assert "2 further flights: +3.0 in all, 1 of them without gain" in told

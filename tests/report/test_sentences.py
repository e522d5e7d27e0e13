"""Results in plain words."""

from __future__ import annotations

from parameter_makers import described

from enginediag_cli.report import sentences


def test_a_loss_of_efficiency_is_told_in_per_cent_with_its_interval_and_probability():
    assert (
        sentences.change(described("hpc.efficiency"), -0.02, 0.003, chance=0.97)
        == "HPC isentropic efficiency fell by 2.0 % ± 0.3 % (probability 0.97)"
    )


def test_a_sensor_bias_is_told_in_the_sensors_unit():
    assert sentences.change(described("sensor.T3.bias", "K"), 4.12, 0.8) == "T3 sensor reads 4.1 K ± 0.8 K too high"


def test_a_bias_of_a_ratio_is_a_ratio_and_no_share():
    assert sentences.change(described("sensor.BPR.bias", "1"), 0.06) == "BPR sensor reads 0.06 too high"


def test_a_sensor_scale_below_nominal_reads_too_low():
    assert sentences.change(described("sensor.Wf.scale", "1"), -0.015) == "Wf sensor reads 1.5 % too low"


def test_a_departure_names_its_place_its_onset_and_its_evidence():
    assert sentences.departed(45.21, 24.72, 11, 1e-6, where="b22", onset="1200 s") == (
        "b22: departs from nominal, beginning about 1200 s "
        "(statistic 45.2, threshold 24.7, 11 degrees of freedom, p = 1e-06)"
    )


def test_a_nominal_engine_and_a_missing_verdict_do_not_sound_alike():
    healthy = sentences.nominal(9.1, 24.7, 1)
    unknown = sentences.no_verdict("only 3 records in the envelope")
    assert healthy == "agrees with nominal (statistic 9.1, threshold 24.7, 1 degree of freedom)"
    assert unknown == "no verdict: only 3 records in the envelope"


def test_a_sensor_and_a_component_as_rivals_are_told_the_likelier_first():
    told = sentences.sensor_or_component(
        ["T3 sensor bias"], ["HPC isentropic efficiency"], 0.41, 0.55, ["fan isentropic efficiency"]
    )
    assert told == (
        "HPC isentropic efficiency is indistinguishable from T3 sensor bias (beside fan isentropic efficiency): "
        "0.55 against 0.41"
    )


def test_a_fault_of_the_catalogue_is_told_with_its_severity():
    told = sentences.named_fault([("hpc_fouling", 0.93, 0.12)], 0.93)
    assert told == "HPC fouling, severity 0.93 ± 0.12 (probability 0.93)"


def test_records_that_are_needed_are_counted_and_those_that_do_not_help_named():
    assert sentences.further_records("with T4_K", 12, 20, 0.512) == (
        "12 records with T4_K for odds of 20 to 1 (non-centrality 0.512 per record)"
    )
    hopeless = sentences.further_records("like these", float("inf"), 20, 0)
    assert hopeless == "records like these would not separate them"

"""Unit suffixes and conversions against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from enginediag_cli.units import (
    ALIASES,
    UNITS,
    UnitError,
    convert,
    find_unit,
    is_numeric_column,
    split_column,
    split_header,
    to_si,
)


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        ("T3_K", ("T3", "K")),
        ("climb_ft_min", ("climb", "ft_min")),
        ("lh_fuel_flow_lb_h", ("lh_fuel_flow", "lb_h")),
        ("humidity_kg_kg", ("humidity", "kg_kg")),
        ("dT_isa_K", ("dT_isa", "K")),
        ("P30_psia", ("P30", "psia")),
        ("mach", ("mach", "")),
        ("flag_1", ("flag_1", "")),
        ("CO_mg_m3", ("CO_mg_m3", "")),
        ("_K", ("_K", "")),
    ],
)
def test_a_column_splits_into_quantity_and_the_longest_known_unit(column, expected):
    assert split_column(column) == expected


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("P3 [kPa]", ("P3", "kPa")),
        ("Exit T5 (abs) [K]", ("Exit T5 (abs)", "K")),
        ("P3 (psia)", ("P3", "psia")),
        ("P3 kPa", ("P3", "kPa")),
        ("Fuel, l/h", ("Fuel", "l/h")),
        ("P3_kPa", ("P3", "kPa")),
        ("Class C", ("Class C", "")),
        ("note (late)", ("note (late)", "")),
    ],
)
def test_a_foreign_header_splits_into_quantity_and_unit_as_written(header, expected):
    assert split_header(header) == expected


@pytest.mark.parametrize(
    ("value", "unit", "si"),
    [
        (0.0, "degC", 273.15),
        (-459.67, "degF", 0.0),
        (212.0, "°F", 373.15),
        (518.67, "degR", 288.15),
        (14.695948775513449, "psia", 101325.0),
        (1.0, "bar", 1e5),
        (1013.25, "mbar", 101325.0),
        (1.0, "atm", 101325.0),
        (29.921252, "inHg", 101325.0),
        (1.0, "ft", 0.3048),
        (35.0, "kft", 10668.0),
        (1.0, "kt", 1852 / 3600),
        (1000.0, "ft_min", 5.08),
        (1.0, "lb_s", 0.45359237),
        (7936.64143865559, "pph", 1.0),
        (3.6, "t/h", 1.0),
        (1.0, "Hz", 60.0),
        (math.pi, "rad/s", 30.0),
        (1.0, "hp", 745.69987158227),
        (1.0, "lbf", 4.4482216152605),
        (180.0, "deg", math.pi),
        (50.0, "%", 0.5),
        (2.0, "h", 7200.0),
        (1.0, "shp", 745.69987158227),
        (60.0, "kg/min", 1.0),
        (60.0, "l/min", 1e-3),
        (1.0, "gal/h", 3.785411784e-3 / 3600),
        (6.7, "lb/gal", 802.837063),
        (134.0, "MWh_h", 134e6),
    ],
)
def test_conversions_agree_with_the_published_definitions(value, unit, si):
    assert to_si(value, unit) == pytest.approx(si, rel=1e-6, abs=1e-9)


def test_going_to_si_and_back_returns_the_value_in_every_unit():
    values = np.array([-40.0, 0.0, 1.0, 518.67])
    for unit in [*UNITS, *ALIASES]:
        known = find_unit(unit)
        back = (to_si(values, unit) - known.offset) / known.factor
        np.testing.assert_allclose(back, values, rtol=1e-13, atol=1e-10)


def test_temperatures_convert_as_points_on_the_scale():
    assert convert(-40.0, "degC", "degF") == pytest.approx(-40.0)


def test_percent_of_full_scale_becomes_the_full_scale_unit():
    assert to_si(98.0, "pct", 15900) == pytest.approx(15582.0)
    with pytest.raises(UnitError, match="pct"):
        to_si(98.0, "rpm", 15900)


@pytest.mark.parametrize(("wrong", "near"), [("kgs", "kg_s"), ("DEGC", "degC"), ("psii", "psi"), ("inhg", "inHg")])
def test_an_unknown_unit_names_a_near_match(wrong, near):
    with pytest.raises(UnitError, match=f"did you mean '{near}"):
        find_unit(wrong)


def test_units_of_different_dimensions_do_not_convert():
    with pytest.raises(UnitError, match=r"K is a temperature and Pa is a pressure"):
        convert(1.0, "K", "Pa")


def test_a_column_is_numeric_by_its_unit_or_by_its_well_known_name():
    assert is_numeric_column("Wf_kg_s") and is_numeric_column("mach") and is_numeric_column("BPR")
    assert not is_numeric_column("engine") and not is_numeric_column("flight")

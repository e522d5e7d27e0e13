from __future__ import annotations

import pytest

from enginediag_cli.config.fields import Field, near, same_quantity, unknown_key

FIELDS = (
    Field("area_m2", "number", "", unit="m²"),
    Field("altitude_m", "number", "", unit="m"),
    Field("fuel_flow_kg_s", "number", "", unit="kg/s"),
    Field("inlet_K", "number", "", unit="K"),
    Field("inlet_pressure_Pa", "number", "", unit="Pa"),
    Field("pressure_ratio", "number", ""),
)
NAMES = [field.name for field in FIELDS]


def test_a_near_name_is_suggested_and_otherwise_all_are_listed() -> None:
    assert near("hpp", ["lp", "hp"]) == "did you mean 'hp'?"
    assert near("HPC", ["fan", "hpc"]) == "did you mean 'hpc'?"
    assert near("zzz", ["lp", "hp"]) == "one of: lp, hp"
    assert near("zzz", ["lp"]) == "the only one is lp"
    assert near("zzz", []) == "there are none"
    assert near("zzz", [f"a{k}" for k in range(25)]).endswith("a18, a19, … (25 in all)")


@pytest.mark.parametrize(
    ("key", "meant"),
    [
        ("area_in2", "area_m2"),
        ("area", "area_m2"),
        ("altitude_ft", "altitude_m"),
        ("altitude", "altitude_m"),
        ("fuel_flow_lb_h", "fuel_flow_kg_s"),
        ("inlet_degC", "inlet_K"),
        ("inlet_pressure_psi", "inlet_pressure_Pa"),
        ("Altitude_FT", "altitude_m"),
    ],
)
def test_a_key_with_another_unit_is_recognised(key: str, meant: str) -> None:
    field = same_quantity(key, FIELDS)
    assert field is not None
    assert field.name == meant
    hint, name = unknown_key(key, "text", FIELDS, NAMES)
    assert hint == f"did you mean '{meant}'? this key wants {field.unit}"
    assert name == meant


@pytest.mark.parametrize("key", ["pressure_ratio_psi", "areas", "throat_area_in2", "altitude_reference"])
def test_another_quantity_is_not_taken_for_another_unit(key: str) -> None:
    assert same_quantity(key, FIELDS) is None


def test_the_value_is_converted_where_both_units_are_known() -> None:
    assert unknown_key("altitude_ft", 35000, FIELDS, NAMES)[0] == ("did you mean 'altitude_m: 10668'? this key wants m")
    assert unknown_key("fuel_flow_lb_h", 7936.64, FIELDS, NAMES)[0] == (
        "did you mean 'fuel_flow_kg_s: 1'? this key wants kg/s"
    )


def test_a_temperature_is_not_converted_because_it_may_be_a_difference() -> None:
    assert unknown_key("inlet_degC", 15, FIELDS, NAMES)[0] == "did you mean 'inlet_K'? this key wants K"

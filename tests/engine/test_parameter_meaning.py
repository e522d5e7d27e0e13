"""What a parameter is stands in it: component, quantity, words, unit, wear, and how far a search moves it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components import COMPONENTS
from enginediag_cli.engine.components.base import FROM, HEALTH_ROAMS, NAME, TO, Component
from enginediag_cli.engine.term import Driver, Term
from enginediag_cli.mismatch.fit.freeform import list_locations
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.shipped import shipped

ENGINES = sorted(p.name for p in Path(str(shipped("turbofan.yaml"))).parent.glob("*.yaml"))


class Heater(Component):
    """Stands for any component that somebody adds: it has an effectiveness and leaves the flow alone."""

    TYPE = "heater"
    SECTION = Section("heater", "heats nothing", (NAME, FROM, TO, Field("note", "text", "no matter", "")))

    def parameters(self):
        return (self.health("effectiveness", "share of the temperature difference"),)

    def evaluate(self, e):
        e.flows[self.values["to"]] = e.flows[self.values["from"]]


@pytest.fixture(scope="module")
def every():
    return {name: load_engine(str(shipped(name))) for name in ENGINES}


@pytest.mark.parametrize("name", ENGINES)
def test_every_parameter_says_what_it_is(every, name):
    for p in every[name].parameters.values():
        assert p.component and p.quantity and p.words and p.part and p.unit, p
        # a sensor is called as its column is
        assert p.belongs_to_sensor or ("_" not in p.words and not p.words.endswith(f" {p.unit}")), p.words


@pytest.mark.parametrize("name", ENGINES)
def test_no_two_parameters_of_an_engine_are_told_alike(every, name):
    words = [p.words for p in every[name].parameters.values()]
    assert len(set(words)) == len(words)


def test_the_efficiency_of_a_generator_is_not_called_isentropic(every):
    assert every["power_plant.yaml"].parameters["generator.efficiency"].words == "generator efficiency"


def test_each_component_says_what_kind_of_efficiency_it_has(every):
    parameters = every["turbofan.yaml"].parameters
    told = {n: parameters[n].words for n in ("hpc.efficiency", "burner.efficiency", "hp.mechanical_efficiency")}
    assert told == {
        "hpc.efficiency": "HPC isentropic efficiency",
        "burner.efficiency": "burner combustion efficiency",
        "hp.mechanical_efficiency": "HP mechanical efficiency",
    }


def renamed(tmp_path, change) -> str:
    document = yaml.safe_load(Path(str(shipped("turbojet.yaml"))).read_text(encoding="utf-8"))
    change(document)
    path = tmp_path / "engine.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return str(path)


def test_a_burner_named_cc_has_a_combustion_efficiency(tmp_path):
    def change(document):
        next(c for c in document["components"] if c["type"] == "burner")["name"] = "cc"

    assert load_engine(renamed(tmp_path, change)).parameters["cc.efficiency"].words == "cc combustion efficiency"


def test_the_effectiveness_of_a_new_component_is_a_place_to_look(tmp_path, monkeypatch):
    monkeypatch.setitem(COMPONENTS, Heater.TYPE, Heater)
    heater = Heater({"name": "recuperator", "from": "3", "to": "31"})
    (p,) = heater.parameters()
    assert (p.words, p.roams, p.family) == ("recuperator effectiveness", HEALTH_ROAMS, "health")
    engine = load_engine(str(shipped("turbojet.yaml")))
    engine.parameters[p.name] = p
    assert "recuperator.effectiveness" in [place.name for place in list_locations(engine, ["T3_K"])]


def test_what_wears_out_can_only_fall(every):
    parameters = every["turbofan.yaml"].parameters
    assert parameters["hpc.efficiency"].wear == -1 and parameters["hpc.flow_capacity"].wear == -1
    assert parameters["hpt.flow_capacity"].wear == 0


def test_a_loss_that_was_identified_larger_may_vary_by_as_large_a_part_of_itself(every):
    engine = every["turbofan.yaml"]
    p, recovery = engine.parameters["tailpipe.pressure_loss"], engine.parameters["inlet.pressure_recovery"]
    assert p.with_nominal(2 * p.nominal).roams == pytest.approx(2 * p.roams)
    assert recovery.with_nominal(0.9).roams == recovery.roams


def test_a_parameter_survives_the_way_through_its_description(every):
    for p in every["turbofan.yaml"].parameters.values():
        again = Parameter.from_mapping(p.as_mapping())
        assert again.as_mapping() == p.as_mapping() and again.belongs_to_sensor == p.belongs_to_sensor


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"wear": 2}, "none of -1, 0, 1"),
        ({"wear": "down"}, "not a whole number"),
        ({"family": "odd"}, "'family' is none of"),
        ({"component": ""}, "must not be empty"),
        ({"colour": "red"}, "unknown entry 'colour'"),
    ],
)
def test_a_spoilt_description_is_refused_with_what_is_wrong(every, change, reason):
    known = every["turbofan.yaml"].parameters["hpc.efficiency"].as_mapping()
    with pytest.raises(ValueError, match=reason):
        Parameter.from_mapping(known | change)


def test_a_term_whose_driver_is_a_word_is_refused_with_what_to_do():
    with pytest.raises(TypeError, match=r"name one of enginediag_cli\.drivers .* or bring one"):
        type("Odd", (Term,), {"NAME": "odd", "DRIVER": "fuel_temperature"})
    type("Good", (Term,), {"NAME": "good", "DRIVER": Driver("fuel_temperature", "fuel temperature", "K")})

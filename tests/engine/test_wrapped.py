"""A model around another takes what is its own out of a question and passes on all else."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from enginediag_cli.engine.wrapped import PredictionRequest, WrappedModel
from enginediag_cli.parameters import Parameter


@dataclass(frozen=True)
class Answer:
    y: np.ndarray
    jacobian: np.ndarray
    wrt: tuple[str, ...]


def parameter(name: str, nominal: float = 0.0) -> Parameter:
    return Parameter(name, "design", nominal, -np.inf, np.inf, 1.0)


class Inner:
    """y = u + a, with ∂y/∂u = 1 and ∂y/∂a = 1."""

    name, inputs, monitored = "inner", ("u",), ("a",)

    def __init__(self) -> None:
        self.parameters = {"a": parameter("a")}
        self.asked: dict[str, Any] = {}

    def predict(self, inputs, parameters=None, *, sensors=None, wrt=(), **options):
        self.asked = {"parameters": parameters, "sensors": sensors, "wrt": wrt, "options": options}
        y = np.asarray(inputs["u"], float)[:, None] + (parameters or {}).get("a", 0.0)
        return Answer(y, np.ones((*y.shape, len(wrt))), tuple(wrt))


class Scaled(WrappedModel):
    """The input is `scale` times what was read."""

    def __init__(self, model: Any, name: str = "scale"):
        super().__init__(model, {name: parameter(name, 1.0)})
        self._name = name

    def _predict(self, asked: PredictionRequest) -> Any:
        u = np.asarray(asked.inputs["u"], float)
        true = {"u": u * asked.own.get(self._name, 1.0)}
        return self._predict_inner_scaled(asked, {self._name: "u"}, {self._name: u}, inputs=true)


U = {"u": np.array([1.0, 2.0, 5.0])}


def test_the_inner_model_is_asked_without_what_is_the_wrappers():
    inner = Inner()
    found = Scaled(inner).predict(U, {"scale": 2.0, "a": 3.0}, sensors=("y",), wrt=("a", "scale"), start=4)
    assert inner.asked == {"parameters": {"a": 3.0}, "sensors": ("y",), "wrt": ("a", "u"), "options": {"start": 4}}
    np.testing.assert_array_equal(found.y[:, 0], 2 * U["u"] + 3)


def test_own_directions_stand_where_they_were_asked_for():
    found = Scaled(Inner()).predict(U, wrt=("scale", "u", "a"))
    assert found.wrt == ("scale", "u", "a")
    np.testing.assert_array_equal(found.jacobian[:, 0], np.column_stack([U["u"], np.ones(3), np.ones(3)]))


def test_a_question_that_is_all_the_inner_models_is_answered_by_it_alone():
    answers = []

    class Remembering(Inner):
        def predict(self, *question, **more):
            answers.append(super().predict(*question, **more))
            return answers[-1]

    assert Scaled(Remembering()).predict(U, {"a": 1.0}, wrt=("a",)) is answers[0]


def test_wrappers_stand_in_one_another():
    both = Scaled(Scaled(Inner(), "first"), "second")
    found = both.predict(U, {"first": 2.0, "second": 3.0}, wrt=("second", "first"))
    np.testing.assert_array_equal(found.y[:, 0], 6 * U["u"])
    assert list(both.parameters) == ["a", "first", "second"] and found.wrt == ("second", "first")


def test_all_else_is_the_inner_models_in_a_copy_too():
    model = Scaled(Inner())
    for same in (model, copy.copy(model), copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert (same.name, same.inputs, same.monitored) == ("inner", ("u",), ("a",))
        with pytest.raises(AttributeError, match="no_such_thing"):
            _ = same.no_such_thing


def test_what_a_wrapper_adds_it_must_say():
    with pytest.raises(TypeError, match="_predict"):
        WrappedModel(Inner(), {})

from __future__ import annotations

import numpy as np

from enginediag_cli.recordings.table import Recording
from enginediag_cli.simulation.simulate import to_conditions, to_recording


def test_numbers_and_text_of_a_recording_come_through_in_their_order():
    recording = Recording({"time_s": np.arange(3.0)}, {"tail": ["007", "no", "x"]}, ("tail", "time_s"))
    conditions = to_conditions(recording)
    assert list(conditions.columns) == ["tail", "time_s"]
    back = to_recording(conditions.columns)
    assert back.order == recording.order and list(back.text["tail"]) == ["007", "no", "x"]
    np.testing.assert_array_equal(back.columns["time_s"], recording.columns["time_s"])

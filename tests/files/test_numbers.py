"""Numbers as JSON values."""

import math

import numpy as np

from msl_fem.files.numbers import json_value


class Record:
    def to_json(self) -> dict[str, object]:
        return {"force_N": np.float32(0.5), "gap_m": math.nan}


def test_json_holds_nothing_that_is_not_json() -> None:
    given = {"a": np.float64(math.nan), "b": np.arange(3), "c": (np.int64(1), math.inf), "d": np.bool_(True), 5: None}
    assert json_value(given) == {"a": None, "b": [0, 1, 2], "c": [1, None], "d": True, "5": None}


def test_a_record_says_itself_what_it_is_in_json() -> None:
    assert json_value([Record(), np.array([[1.0, -math.inf]])]) == [{"force_N": 0.5, "gap_m": None}, [[1.0, None]]]

"""The menu of next experiments cut down: judging it takes most of a diagnosis that ends with two alike names."""

from itertools import islice

import pytest

from msl_fem.diagnosis import next_experiment
from msl_fem.diagnosis.next_experiment import Entry, Question, menu


def cut_menu(patch: pytest.MonkeyPatch, *, entries: int = 1) -> None:
    """Only the first entries are judged; the whole menu is in test_next_experiment."""

    def first_ones(question: Question) -> list[Entry]:
        return list(islice(menu(question), entries))

    patch.setattr(next_experiment, "menu", first_ones)

"""The menu of next experiments cut down: judging it takes most of a diagnosis that ends with two alike names."""

from itertools import islice

import pytest

from msl_fem.diagnosis import next_experiment
from msl_fem.diagnosis.next_experiment import Entry, Question, menu


def cut_menu(patch: pytest.MonkeyPatch) -> None:
    """Only the first entry is judged; the whole menu is in test_next_experiment."""

    def first_of_all(question: Question) -> list[Entry]:
        return list(islice(menu(question), 1))

    patch.setattr(next_experiment, "menu", first_of_all)

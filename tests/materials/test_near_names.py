"""A steel's usual name leads to the library's; what is like none leads to the list alone."""

import pytest

from msl_fem.errors import MaterialError
from msl_fem.materials.material import load_iron


@pytest.mark.parametrize(
    ("name", "meant"),
    [("M400-50A", "m400_50a_pyleecan"), ("M19 ", "m19"), ("steel-1020", "steel_1020")],
)
def test_a_name_as_people_write_it_is_suggested(name: str, meant: str) -> None:
    with pytest.raises(MaterialError, match=f"unknown iron '{name}', is {meant} meant?"):
        load_iron(name)


def test_a_strange_name_suggests_nothing() -> None:
    with pytest.raises(MaterialError, match="unknown iron 'unobtainium'; the library has hiperco_50"):
        load_iron("unobtainium")

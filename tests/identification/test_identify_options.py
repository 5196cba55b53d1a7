"""What the command's options stand for."""

from pathlib import Path

import pytest

from msl_fem.cli.identify import _orders, _terms, command
from msl_fem.errors import InputError
from msl_fem.identification import ArmaxOrders


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("", ((), False)),
        ("i1^2/g1^2, i2", (("i1^2/g1^2", "i2"), False)),
        ("auto", ((), True)),
        ("auto: i1, i1^2/g1^2", (("i1", "i1^2/g1^2"), True)),
    ],
)
def test_terms(text, meant):
    assert _terms(text) == meant


def test_orders():
    assert _orders("") is None
    assert _orders("auto") == "auto"
    assert _orders("3,2,1") == ArmaxOrders(3, 2, 1, 1)
    assert _orders("3,2,1,2") == ArmaxOrders(3, 2, 1, 2)


@pytest.mark.parametrize(("read", "text"), [(_terms, "auto:"), (_orders, "2,2"), (_orders, "automatic")])
def test_what_is_not_understood(read, text):
    with pytest.raises(InputError, match="auto"):
        read(text)


def test_a_structure_that_is_none():
    with pytest.raises(InputError, match="--structure 'arx': give armax, output-error, box-jenkins"):
        command(Path("nowhere"), structure="arx")

"""The option `--effect`: causes that the user states by laws."""

from msl_fem.computing.laws import LawExpression, causes_of
from msl_fem.errors import InputError


def read_causes(texts: list[str] | None) -> tuple[LawExpression, ...]:
    """The causes that the user states; the error names the option."""
    try:
        return tuple(one for text in texts or [] for one in causes_of(text))
    except InputError as err:
        raise InputError(f"--effect: {err}") from err

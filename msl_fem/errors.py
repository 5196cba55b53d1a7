"""The errors a caller can meet. Each derives from a builtin, so that callers need not know this package.

`InputError` and its children are the user's to mend (the command line ends with status 2); `ComputationError`
and its children mean that a computation did not reach an answer (status 1).
"""


class InputError(ValueError):
    """What was asked for cannot be: the message names the value, the allowed range and the way out."""


class QuantityError(InputError):
    """A text is not a number with the expected unit."""


class ActuatorError(InputError):
    """An actuator file is not one: the message names the file and the key path."""


class RequirementError(InputError):
    """A requirement file is not one, or no magnet can meet it: the message says which demands clash and by how much."""


class MaterialError(InputError):
    """An iron is unknown, or its B-H curve fails the checks."""


class TableError(InputError):
    """A file is not a magnetic table, or its content contradicts itself."""


class OutOfTable(InputError):  # noqa: N818 - reads as the sentence it stands for
    """A query lies outside the table's rectangle; tables are never extrapolated."""


class RecordError(InputError):
    """A record of measured data is refused: the message names file, row and column."""


class ComputationError(RuntimeError):
    """A computation failed; the message says where, why and what to try."""


class CostWarning(UserWarning):
    """What was asked for is possible and costs far more than usual; the message names the key and what to write."""


class FolderWarning(UserWarning):
    """A folder to write into was not there and has been made, which a mistyped path would do too."""


class NotConverged(ComputationError):  # noqa: N818
    """An iteration did not reach its tolerance; the trail of residuals is in the message."""

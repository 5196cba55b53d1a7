"""Laws that users write: text to a checked tree, its units, values, derivatives and source as compiled Python."""

from msl_fem.computing.laws.expression import (
    UNIT_OF,
    VARIABLES,
    LawExpression,
    LawParameter,
    expression,
    expression_of_toml,
    parse_expression,
)
from msl_fem.computing.laws.reading import causes_of, expressions_of_table

__all__ = [
    "UNIT_OF",
    "VARIABLES",
    "LawExpression",
    "LawParameter",
    "causes_of",
    "expression",
    "expression_of_toml",
    "expressions_of_table",
    "parse_expression",
]

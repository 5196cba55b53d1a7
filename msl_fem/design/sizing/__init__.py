"""Sizing: from what a magnet has to do to an actuator file, by closed equations, a search, and fields that judge it."""

from msl_fem.design.sizing.choice import (
    RULE,
    DesignChoice,
    choose_design,
    pareto_front,
    sized_actuator,
    write_sized_actuator,
)
from msl_fem.design.sizing.design import Constraint, Design
from msl_fem.design.sizing.evaluation import DesignEvaluation, DesignEvaluator
from msl_fem.design.sizing.requirement import Requirement, load_requirement, parse_requirement
from msl_fem.design.sizing.search import SearchResult, SearchSettings, first_designs, search_designs
from msl_fem.design.sizing.sized import SizedMagnet, size_magnet
from msl_fem.design.sizing.trials import EvaluatedTrial, figures

__all__ = [
    "RULE",
    "Constraint",
    "Design",
    "DesignChoice",
    "DesignEvaluation",
    "DesignEvaluator",
    "EvaluatedTrial",
    "Requirement",
    "SearchResult",
    "SearchSettings",
    "SizedMagnet",
    "choose_design",
    "figures",
    "first_designs",
    "load_requirement",
    "pareto_front",
    "parse_requirement",
    "search_designs",
    "size_magnet",
    "sized_actuator",
    "write_sized_actuator",
]

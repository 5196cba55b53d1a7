"""Sizing: from what a magnet has to do to an actuator file, by closed equations, a search, and fields that judge it."""

from msl_fem.design.sizing.choice import RULE, Choice, choose, pareto_front, sized_actuator, write_sized_actuator
from msl_fem.design.sizing.design import Constraint, Design
from msl_fem.design.sizing.evaluation import Judge, Verdict
from msl_fem.design.sizing.requirement import Requirement, load_requirement, parse_requirement
from msl_fem.design.sizing.search import SearchResult, SearchSettings, first_designs, search
from msl_fem.design.sizing.trials import JudgedTrial, figures

__all__ = [
    "RULE",
    "Choice",
    "Constraint",
    "Design",
    "Judge",
    "JudgedTrial",
    "Requirement",
    "SearchResult",
    "SearchSettings",
    "Verdict",
    "choose",
    "figures",
    "first_designs",
    "load_requirement",
    "pareto_front",
    "parse_requirement",
    "search",
    "sized_actuator",
    "write_sized_actuator",
]

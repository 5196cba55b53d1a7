"""Constraints: a value beside its limit, and by how much it keeps or breaks it."""

from dataclasses import dataclass
from typing import Any

LARGEST = 1e6  # of a violation
ROUNDING = 1e-9  # relative: what adding lengths costs


@dataclass(frozen=True)
class Constraint:
    """One demand on a design.

    Attributes
    ----------
    value, limit : in `unit`
    upper : the value must not be above the limit (else: not below it)
    """

    name: str
    value: float
    limit: float
    unit: str
    upper: bool

    @property
    def margin(self) -> float:
        """In `unit`; negative where the constraint is broken."""
        return self.limit - self.value if self.upper else self.value - self.limit

    @property
    def violation(self) -> float:
        """Relative to the limit; at most 0 where the constraint is kept, and never infinite."""
        return min(max(-self.margin / abs(self.limit) - ROUNDING, -LARGEST), LARGEST)

    @property
    def kept(self) -> bool:
        return self.violation <= 0

    def fields(self) -> dict[str, Any]:
        """As JSON states it."""
        return {
            "name": self.name, "value": self.value, "limit": self.limit, "margin": self.margin, "unit": self.unit,
            "at": "most" if self.upper else "least",
        }  # fmt: skip


def at_most(name: str, value: float, limit: float, unit: str) -> Constraint:
    """The value must not be above the limit."""
    return Constraint(name, value, limit, unit, True)


def at_least(name: str, value: float, limit: float, unit: str) -> Constraint:
    """The value must not be below the limit."""
    return Constraint(name, value, limit, unit, False)


def total_violation(constraints: tuple[Constraint, ...]) -> float:
    """The sum of what is broken, relative to the limits; 0 where all is kept."""
    return sum(max(c.violation, 0.0) for c in constraints)

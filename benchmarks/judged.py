"""What a real set showed beside what is known of it: rows and values of the tables of docs/real_records.md."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

DATA = Path(__file__).parent.parent / "measurements"


@dataclass(frozen=True)
class Value:
    """A number that is known of a set, and found: `interval` of what was found, `stated` the range that the authors
    state, `why` where it lies outside of both and more than `allowed` off."""

    of: str
    unit: str
    known: float
    found: float
    interval: tuple[float, float] | None = None
    why: str = ""
    allowed: float = 0.10
    stated: tuple[float, float] | None = None

    @property
    def cells(self) -> list[str]:
        """Of the table of values."""
        known = f"{self.known:.4g}" + ("" if self.stated is None else " ({:.4g} to {:.4g})".format(*self.stated))
        if np.isnan(self.found):
            return [f"{self.of} ({self.unit})", known, "not named", "", "", f"no: {self.why}"]
        between = "none stated" if self.interval is None else "{:.4g} to {:.4g}".format(*self.interval)
        return [
            f"{self.of} ({self.unit})", known, f"{self.found:.4g}", between, f"{100 * self._off:+.1f}",
            f"yes, {self.inside}" if self.inside else f"no: {self.why}",
        ]  # fmt: skip

    @property
    def _off(self) -> float:
        return self.found / self.known - 1

    @property
    def inside(self) -> str:
        """In what the known value and the found one meet; empty where in nothing."""
        within = {"interval": (self.interval, self.known), "stated range": (self.stated, self.found)}
        met = [name for name, (ends, value) in within.items() if ends and ends[0] <= value <= ends[1]]
        met += [f"{self.allowed:.0%}"] if abs(self._off) <= self.allowed else []
        return ", ".join(met)


@dataclass(frozen=True)
class Judged:
    """A row: what is known and how, the verdict, what it means beside what is known, and numbers beside known ones."""

    name: str
    known: str
    verdict: str
    meaning: str
    values: tuple[Value, ...] = ()


def estimated(
    of: str, unit: str, known: float, estimate, *, why: str = "", stated: tuple[float, float] | None = None
) -> Value:
    """A known value beside an estimate with its interval, sizes of both; nothing found is not a number."""
    if estimate is None:
        return Value(of, unit, known, np.nan, None, why, stated=stated)
    ends = sorted((abs(estimate.low), abs(estimate.high)))
    return Value(of, unit, known, abs(estimate.value), (ends[0], ends[1]), why, stated=stated)


def words(found) -> str:
    """The verdict and the named effects."""
    return found.verdict + (f": {', '.join(cause.effect for cause in found.causes)}" if found.causes else "")

"""Irons: H(B), its slope and its energy density; the library, files of points, analytic curves, laminations."""

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.computing.arrays import Array
from msl_fem.errors import MaterialError
from msl_fem.files.schema import small_text
from msl_fem.materials.constants import MU_0

if TYPE_CHECKING:  # imported where curves are made: it takes longer than all the rest of a control engineer's import
    from scipy.interpolate import BPoly, PPoly

LIBRARY = Path(__file__).parent
MIN_POINTS = 5
LARGEST_POLARISATION, DOUBTFUL_POLARISATION = 2.6, 2.45  # T; iron-cobalt, the highest of all, saturates at 2.43 T
LARGEST_PERMEABILITY, DOUBTFUL_PERMEABILITY = 1e6, 3e5  # relative, differential; supermalloy reaches 1e6
SLOPE_TOLERANCE = 1e-4  # of mu_0: what rounding in printed curves amounts to


@dataclass(frozen=True, eq=False)
class Iron:
    """An isotropic iron without hysteresis, given by points of its anhysteretic (or normal) curve.

    Between the points H(B) is the cubic spline through them if that keeps dB/dH positive and at least mu_0, and else
    the monotone cubic (Fritsch and Carlson 1980, slopes of Fritsch and Butland 1984). Beyond the last point the
    polarisation follows the first term of the law of approach to saturation, J = J_s - J_1/H (Becker and Doering
    1939), with the last slope: slope and value are continuous, and dB/dH tends to mu_0.

    Attributes
    ----------
    flux_density, field_strength : the points used (n_point,), in T and A/m, starting at 0, 0
    source : where the curve comes from
    note : what was done to the points, empty where nothing was
    stacking_factor : that of the lamination; the curve then relates the flux density averaged over sheets
    """

    name: str
    flux_density: Array
    field_strength: Array
    source: str
    note: str = ""
    stacking_factor: float = 1.0

    @property
    def tail_from(self) -> float:
        """The (averaged) flux density in T beyond which an answer rests on the tail, not on the points."""
        return float(self.flux_density[-1])

    @cached_property
    def _curve(self) -> "PPoly":
        from scipy.interpolate import CubicSpline, PPoly

        b, h = self.flux_density, self.field_strength
        spline = CubicSpline(b, h, bc_type=((2, 0.0), "not-a-knot"))
        slope = spline.derivative()
        turns = slope.derivative().roots(extrapolate=False)
        extremes = slope(np.r_[b, turns[np.isfinite(turns)]])
        if extremes.min() > 0 and MU_0 * extremes.max() <= 1 + SLOPE_TOLERANCE:
            return PPoly(spline.c, spline.x)
        return PPoly.from_bernstein_basis(_monotone(b, h))

    @cached_property
    def _energy(self) -> "PPoly":
        return self._curve.antiderivative()

    @cached_property
    def _tail(self) -> tuple[float, float, float, float]:
        """B, H, dJ/dH and J_s where the points end."""
        b = float(self.flux_density[-1])
        h = float(self.field_strength[-1])
        susceptibility = max(1.0 / float(self._curve(b, 1)) - MU_0, 0.0)
        return b, h, susceptibility, b - MU_0 * h + susceptibility * h

    def magnetise(self, flux_density: ArrayLike) -> tuple[Array, Array]:
        """H in A/m and dH/dB in A/(m T) at |B| in T, both of the shape given."""
        b = np.asarray(flux_density, dtype=float)
        inside = np.minimum(b, self.tail_from)
        h = self._curve(inside)
        slope = self._curve(inside, 1)
        if b.size and b.max() > self.tail_from:
            beyond = b > self.tail_from
            h[beyond], slope[beyond] = self._magnetise_tail(b[beyond])
        return h, slope

    def field_strength_at(self, flux_density: Array) -> Array:
        """H in A/m at |B| in T, that of `magnetise` alone."""
        if flux_density.size and flux_density.max() > self.tail_from:
            return self.magnetise(flux_density)[0]
        return np.asarray(self._curve(flux_density))

    def _magnetise_tail(self, b: Array) -> tuple[Array, Array]:
        _, h_end, susceptibility, j_sat = self._tail
        # mu_0 H^2 + (J_s - B) H - chi H_end^2 = 0
        half = (b - j_sat) / (2 * MU_0)
        h = half + np.sqrt(half**2 + susceptibility * h_end**2 / MU_0)
        return h, 1.0 / (MU_0 + susceptibility * (h_end / h) ** 2)

    def energy_density(self, flux_density: ArrayLike) -> Array:
        """w(B), the integral of H dB from 0, in J/m3."""
        b = np.asarray(flux_density, dtype=float)
        w = self._energy(np.minimum(b, self.tail_from))
        if b.size and b.max() > self.tail_from:
            beyond = b > self.tail_from
            b_end, h_end, susceptibility, j_sat = self._tail
            h, _ = self._magnetise_tail(b[beyond])
            coenergy = MU_0 * (h**2 - h_end**2) / 2 + j_sat * (h - h_end)
            coenergy -= susceptibility * h_end**2 * np.log(h / h_end)
            w[beyond] += b[beyond] * h - b_end * h_end - coenergy
        return w

    def iron_flux_density(self, flux_density: ArrayLike) -> Array:
        """The flux density in the sheets themselves, from that averaged over sheets and insulation, in T."""
        return _flux_density_in_sheets(self, np.asarray(flux_density, dtype=float))


def _flux_density_in_sheets(iron: "Iron | AnalyticIron", b: Array) -> Array:
    s = iron.stacking_factor
    return b if s == 1.0 else (b - (1 - s) * MU_0 * iron.magnetise(b)[0]) / s


def _monotone(b: Array, h: Array) -> "BPoly":
    """The cubic on which H and B/mu_0 - H are both monotone, so that 0 <= dH/dB <= 1/mu_0.

    A cubic is monotone where both its slopes are at most three times the secant's (Fritsch and Carlson 1980). The slope
    at B = 0 is that of the odd curve, and none vanishes: an iron of infinite permeability has no field solution.
    """
    from scipy.interpolate import BPoly, PchipInterpolator

    secant = np.diff(h) / np.diff(b)
    slack = np.maximum(1 / MU_0 - secant, 0.0)
    least = 1 / MU_0 - 3 * np.minimum(np.r_[slack, slack[-1]], np.r_[slack[0], slack])
    most = 3 * np.minimum(np.r_[secant, secant[-1]], np.r_[secant[0], secant])
    odd = PchipInterpolator(np.r_[-b[1], b], np.r_[-h[1], h])
    slopes = np.minimum(np.clip(odd(b, 1), np.maximum(least, most / 30), 1 / MU_0), most)
    return BPoly.from_derivatives(b, np.column_stack([h, slopes]))


def iron_from_points(flux_density: ArrayLike, field_strength: ArrayLike, *, name: str, source: str) -> Iron:
    """An iron from the points of a B-H curve; it is cut, with a note, where it stops being one.

    A curve starts at 0, 0 (added where it is missing), increases in B and in H, and has dB/dH >= mu_0.

    Raises
    ------
    MaterialError : values not finite or negative, fewer than 5 points left after the cut, or more polarisation or
        permeability than any iron has
    """
    b = np.asarray(flux_density, dtype=float)
    h = np.asarray(field_strength, dtype=float)
    if b.shape != h.shape or b.ndim != 1 or not (np.isfinite(b).all() and np.isfinite(h).all()):
        raise MaterialError(f"{name}: B and H must be two equally long columns of finite numbers")
    if b.size and (b[0] < 0 or h[0] < 0):
        raise MaterialError(f"{name}: starts at B = {b[0]:g} T, H = {h[0]:g} A/m; give the curve for B, H >= 0")
    if b.size and b[0] > 0:
        b = np.r_[0.0, b]
        h = np.r_[0.0, h]
    bad = (np.diff(b) <= 0) | (np.diff(h) <= 0)
    if b.size and (b[0] != 0 or h[0] != 0):
        bad[:1] = True
    bad |= np.diff(b) < MU_0 * (1 - SLOPE_TOLERANCE) * np.diff(h)
    keep = int(np.argmax(bad)) + 1 if bad.any() else b.size
    note = ""
    if keep < b.size:
        note = (
            f"{name}: the curve is cut after B = {b[keep - 1]:g} T (point {keep} of {b.size}), where it stops "
            "increasing at least as fast as vacuum; the saturation tail follows"
        )
    if keep < MIN_POINTS:
        raise MaterialError(
            f"{name}: {keep} usable points of {b.size}, at least {MIN_POINTS} are needed (0, 0 counts); "
            f"{note or 'give more'}"
        )
    doubt = _doubt(b[:keep], h[:keep], name)
    return Iron(name, b[:keep], h[:keep], source=source, note="; ".join(text for text in (note, doubt) if text))


def _doubt(b: Array, h: Array, name: str) -> str:
    """What an iron seldom has, as a note; MaterialError for what none has: mistakes of units and of columns."""
    polarisation = float((b - MU_0 * h).max())
    with np.errstate(over="ignore"):  # of fields that differ by less than a float can tell: infinite, and refused
        permeability = float((np.diff(b) / np.diff(h)).max() / MU_0)
    has = f"{name}: a polarisation of {polarisation:.4g} T and a relative permeability of {permeability:.4g}"
    if polarisation > LARGEST_POLARISATION or permeability > LARGEST_PERMEABILITY:
        raise MaterialError(
            f"{has} are more than any iron's, at most {LARGEST_POLARISATION:g} T and {LARGEST_PERMEABILITY:g}; look at "
            "the units (B in T, not gauss or mT; H in A/m, not oersted or kA/m) and at the order of the columns"
        )
    if polarisation > DOUBTFUL_POLARISATION or permeability > DOUBTFUL_PERMEABILITY:
        return f"{has} are seldom met; look at the units (B in T, H in A/m)"
    return ""


@lru_cache(maxsize=32)
def laminated(iron: "Iron | AnalyticIron", stacking_factor: float) -> "Iron | AnalyticIron":
    """The homogenised stack of sheets: B = s B_iron(H) + (1 - s) mu_0 H, flux in the plane of the sheets.

    H is tangential to sheets and insulation and so the same in both, and their fluxes add (Meeker, Bulk "on-edge"
    lamination material model, FEMM 2019). For a curve given by points the rule holds at the points, and between them
    to 3 microtesla at s = 0.96.
    """
    if stacking_factor == 1.0:
        return iron
    if isinstance(iron, AnalyticIron):
        return _laminated_by_formula(iron, stacking_factor)
    b = stacking_factor * iron.flux_density + (1 - stacking_factor) * MU_0 * iron.field_strength
    return replace(iron, flux_density=b, stacking_factor=stacking_factor)


@dataclass(frozen=True, eq=False)
class AnalyticIron:
    """An iron by formula: H = B nu(B), with the same methods as `Iron`.

    Attributes
    ----------
    law : |B| in T to (H, dH/dB)
    energy_law : |B| in T to w in J/m3
    """

    name: str
    law: Callable[[Array], tuple[Array, Array]]
    energy_law: Callable[[Array], Array]
    source: str
    note: str = ""
    tail_from: float = math.inf
    stacking_factor: float = 1.0

    def magnetise(self, flux_density: ArrayLike) -> tuple[Array, Array]:
        """H in A/m and dH/dB in A/(m T) at |B| in T, both of the shape given."""
        return self.law(np.asarray(flux_density, dtype=float))

    def field_strength_at(self, flux_density: Array) -> Array:
        """H in A/m at |B| in T, that of `magnetise` alone."""
        return self.magnetise(flux_density)[0]

    def energy_density(self, flux_density: ArrayLike) -> Array:
        """w(B), the integral of H dB from 0, in J/m3."""
        return self.energy_law(np.asarray(flux_density, dtype=float))

    def iron_flux_density(self, flux_density: ArrayLike) -> Array:
        """The flux density in the sheets themselves, from that averaged over sheets and insulation, in T."""
        return _flux_density_in_sheets(self, np.asarray(flux_density, dtype=float))


def _laminated_by_formula(iron: AnalyticIron, s: float) -> AnalyticIron:
    def solve(b: Array) -> Array:
        """B in the sheets: s B + (1 - s) mu_0 H(B) = b, convex or nearly so, from above."""
        b_iron = b / s
        for _ in range(60):
            h, slope = iron.magnetise(b_iron)
            step = (s * b_iron + (1 - s) * MU_0 * h - b) / (s + (1 - s) * MU_0 * slope)
            b_iron = b_iron - step
            if not b.size or np.abs(step).max() <= 1e-15 * np.abs(b_iron).max():
                break
        return b_iron

    def law(b: Array) -> tuple[Array, Array]:
        h, slope = iron.magnetise(solve(b))
        return h, slope / (s + (1 - s) * MU_0 * slope)

    def energy_law(b: Array) -> Array:
        b_iron = solve(b)
        return s * iron.energy_density(b_iron) + (1 - s) * MU_0 * iron.magnetise(b_iron)[0] ** 2 / 2

    return replace(iron, law=law, energy_law=energy_law, stacking_factor=s)


def linear_iron(relative_permeability: float) -> AnalyticIron:
    """An iron with constant relative permeability, H = B / (mu_0 mu_r).

    Raises
    ------
    MaterialError : mu_r below 1 or not finite
    """
    if not 1 <= relative_permeability < math.inf:
        raise MaterialError(f"linear:{relative_permeability:g}: mu_r must be finite and at least 1")
    nu = 1 / (MU_0 * relative_permeability)
    return AnalyticIron(
        name=f"linear:{relative_permeability:g}",
        law=lambda b: (nu * b, np.full_like(b, nu)),
        energy_law=lambda b: nu * b**2 / 2,
        source="constant permeability",
    )


def e1_iron() -> AnalyticIron:
    """The analytic iron of problem E1: H = (B/mu_0) (eps + (1 - eps) B^11/(B^11 + tau)), eps 1.6e-4, tau 4.4e4."""
    eps, tau, power = 1.6e-4, 4.4e4, 11

    def law(b: Array) -> tuple[Array, Array]:
        share = b**power / (b**power + tau)
        nu = (eps + (1 - eps) * share) / MU_0
        return nu * b, nu + (1 - eps) * power * share * (1 - share) / MU_0

    # w has no elementary form: Gauss quadrature over cells of 5 mT, then the quintic through w, H and dH/dB
    nodes = np.arange(0.0, 6.0 + 2.5e-3, 5e-3)
    x, weight = np.polynomial.legendre.leggauss(6)
    inner = nodes[:-1, None] + (x + 1) / 2 * 5e-3
    w = np.r_[0.0, np.cumsum(law(inner)[0] @ weight * 5e-3 / 2)]
    energy = _quintic(nodes, w, *law(nodes))

    def energy_law(b: Array) -> Array:
        # beyond 6 T the share is 1 - O(1e-4): integrate H = B/mu_0 less the remainder's small constant
        beyond = np.maximum(b, 6.0)
        return energy(np.minimum(b, 6.0)) + (beyond**2 - 36.0) / (2 * MU_0)

    return AnalyticIron(name="analytic:e1", law=law, energy_law=energy_law, source="verification problem E1")


def _quintic(x: Array, value: Array, slope: Array, bend: Array) -> "PPoly":
    """The piecewise quintic with these values and first and second derivatives at x (Hermite)."""
    from scipy.interpolate import PPoly

    h = np.diff(x)
    off = (np.diff(value) - slope[:-1] * h - bend[:-1] * h**2 / 2) / h**3
    off_slope = (np.diff(slope) - bend[:-1] * h) / h**2
    off_bend = np.diff(bend) / h / 2
    third = 10 * off - 4 * off_slope + off_bend
    fourth = (-15 * off + 7 * off_slope - 2 * off_bend) / h
    fifth = (6 * off - 3 * off_slope + off_bend) / h**2
    return PPoly(np.stack([fifth, fourth, third, bend[:-1] / 2, slope[:-1], value[:-1]]), x)


def load_iron(name: str, *, folder: Path | None = None) -> Iron | AnalyticIron:
    """The iron of that name: of the library ("m19"), "linear:1000", "analytic:e1", or a file "path.csv".

    A file has the columns H_A_per_m and B_T; a relative path starts at `folder`.

    Raises
    ------
    MaterialError : unknown name, unreadable file, or a curve that fails the checks of `iron_from_points`
    """
    if not name.endswith(".csv"):
        return _known_iron(name)
    b, h = _read_points(Path(folder or "") / name)
    return iron_from_points(b, h, name=name, source=f"file {name}")


@lru_cache(maxsize=32)
def _known_iron(name: str) -> Iron | AnalyticIron:
    """The iron that no file of the user states: one object for all magnets."""
    if name == "analytic:e1":
        return e1_iron()
    if name.startswith("linear:"):
        try:
            return linear_iron(float(name.removeprefix("linear:")))
        except ValueError as err:
            raise MaterialError(f"{name}: write linear:<mu_r>, mu_r at least 1, like linear:1000") from err
    index = json.loads((LIBRARY / "index.json").read_text())
    if name not in index:
        meant = _nearest(name, list(index))
        raise MaterialError(
            f"unknown iron '{name}'{f', is {meant} meant?' if meant else ''}; "
            f"the library has {', '.join(sorted(index))}; "
            "or give linear:<mu_r>, analytic:e1 or a file.csv with columns H_A_per_m, B_T"
        )
    b, h = _read_points(LIBRARY / f"{name}.csv")
    return iron_from_points(b, h, name=name, source=index[name]["source"])


def _nearest(name: str, known: Sequence[str]) -> str:
    """The known name that is most like one as people write it, "M400-50A" for m400_50a_pyleecan; "" where none is."""
    plain = {
        re.sub(r"[^a-z0-9]", "", one.lower().removesuffix("_pyleecan")): one for one in sorted(known, reverse=True)
    }
    near = get_close_matches(re.sub(r"[^a-z0-9]", "", name.lower()), plain, n=1, cutoff=0.7)
    return plain[near[0]] if near else ""


def _read_points(path: Path) -> tuple[Array, Array]:
    try:
        text = small_text(path, encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except (OSError, ValueError) as err:
        raise MaterialError(f"{path}: cannot be read; give a CSV file with columns H_A_per_m, B_T") from err
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    header = [name.strip() for name in lines[0][1].split(",")] if lines else []
    if sorted(header) != ["B_T", "H_A_per_m"]:
        raise MaterialError(f"{path}: the first line must name the columns H_A_per_m, B_T, each once")
    rows = []
    for number, line in lines[1:]:
        try:
            row = [float(cell) for cell in line.split(",")]
        except ValueError:
            row = []
        if len(row) != 2:
            raise MaterialError(f"{path}: line {number}: expected two numbers, found {line[:40]!r}")
        rows.append(row)
    table = np.array(rows, dtype=float).reshape(-1, 2)
    return table[:, header.index("B_T")], table[:, header.index("H_A_per_m")]

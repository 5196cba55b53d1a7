"""Tables and level currents of made magnets from the reduced field of the nominal one.

The nominal magnet is the parent of a family (`magnetics.reduced.family`) on its mesh moved: a made magnet's field at
all nodes of a table takes as long as a few field solutions, and full steps of Newton's at some nodes certify it. The
currents of the levels follow by Newton's iteration on the criterion, at all gaps and levels at once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.row_cache import Arrays
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.field_map.gap_levels import CurrentContinuation
from msl_fem.magnetics.field_map.readings import reader_of, sheet_flux_density
from msl_fem.magnetics.kinds.ends import leaked
from msl_fem.magnetics.reduced.family import Child, Family, Member, family_of
from msl_fem.magnetics.reduced.full_field import FullField
from msl_fem.magnetics.reduced.reduced_model import FieldPoints, ReducedStates
from msl_fem.magnetics.reduced.reduction import DRAFTED_FOR, LEAST_ESTIMATE, SAFETY, ReductionSettings
from msl_fem.magnetics.solver.postprocess import Probes
from msl_fem.maps.level_currents import Criterion
from msl_fem.materials.curves import Indices

CURRENTS = 11  # of a table, without 0
LEAST_NODES = 60  # of a table
MARGIN = 1.25  # of the nominal magnet's largest current of a level
SECTION_TOLERANCE = 4e-3  # of the highest level: the sections' flux densities, which are no integrals of the energy
MODES = 4.0  # times the tolerance, below which share of a solution a mode is left out
LEARNED_FROM = 6  # made magnets at their limits
CHECKED_OF_EACH = 4  # nodes
CURRENT_TOLERANCE = 1e-5  # relative, the last step
MOST_STEPS = 20

Deviation = Mapping[str, float]
Made = Callable[[Deviation], MagnetField]


@dataclass(frozen=True)
class Nodes:
    """Where made magnets are solved: gaps (m), increasing, and currents (A) of their tables, and flux densities (T)."""

    gaps: tuple[float, ...]
    currents: tuple[float, ...]
    levels: tuple[float, ...]

    def points(self, gaps: Sequence[float]) -> FieldPoints:
        """All currents at each of these gaps."""
        coordinate = np.repeat(np.array(gaps), len(self.currents))
        return FieldPoints(coordinate, np.tile(self.currents, len(gaps))[:, None])


def nodes_of(
    nominal: MagnetField, gaps: Sequence[float], levels: tuple[float, ...], *, most: float, current: float
) -> Nodes:
    """Nodes up to where the nominal magnet takes the highest level, and a current at least; raises NotConverged."""
    reader = reader_of(nominal, Criterion("mean"))
    highest = [CurrentContinuation(nominal, reader, gap).root(levels[-1], most).current for gap in gaps]
    largest = float(np.max(np.where(np.isnan(highest), most, highest)))
    number = max(CURRENTS, -(-LEAST_NODES // len(gaps)))
    top = max(min(MARGIN * largest, most), MARGIN * current)
    return Nodes(tuple(gaps), tuple((top * np.arange(1, number + 1) / number).tolist()), levels)


class MadeTables:
    """Tables of made magnets in the nominal one's space.

    Parameters
    ----------
    made : the field of a deviation
    limits : of the deviations
    nodes : of the tables, to whose gaps a deviation `gap` adds
    most : A, up to which a level is looked for
    point : current (A) and gap (m) of force and flux linkage
    tolerance : of force and flux linkage, of full scale: what checks must hold
    """

    def __init__(
        self,
        made: Made,
        limits: Deviation,
        nodes: Nodes,
        *,
        most: float,
        point: tuple[float, float],
        tolerance: float,
    ) -> None:
        self.nodes, self.point, self._most, self._tolerance, self._made = nodes, point, most, tolerance, made
        off, gaps = limits.get("gap", 0.0), nodes.gaps
        points = nodes.points(sorted({gaps[0] - off, *gaps, gaps[-1] + off}))
        self._chosen = np.flatnonzero(np.isin(points.coordinate, gaps))
        signs = np.random.default_rng(0).choice((-1.0, 1.0), (LEARNED_FROM, len(limits)))
        corners = [{name: float(s) * limits[name] for name, s in zip(limits, row, strict=True)} for row in signs]
        nominal = made({})
        self.family: Family | None = None
        if isinstance(nominal.probes, Probes):
            settings = ReductionSettings(tolerance, drafts=max(1, len(points) // DRAFTED_FOR), modes=MODES)
            members = [lambda corner=corner: _member(made(corner)) for corner in corners]
            self.family = family_of(_member(nominal).full, points, settings, members, CHECKED_OF_EACH)

    def answer(self, deviation: Deviation) -> Arrays | None:
        """What a made magnet's table says; None where no certificate holds, or a level lies beyond the table.

        `table_force` N and `table_flux_linkage` Wb (n_gap, n_current), `current` (n_level, n_gap) A, `force` and
        `flux_linkage` at the point; `table_error` estimates that of the table, of full scale, `section_error` that of
        the sections' flux densities over the highest level.

        Raises
        ------
        ComputationError, ValueError : dimensions that make no magnet
        """
        if self.family is None:
            return None
        field = self._made(deviation)
        child = self.family.child(_member(field, deviation.get("gap", 0.0)), self._chosen)
        if not child.converged:
            return None
        table = MadeTable(field, child, self.nodes)
        changes = [table.changes(int(n)) for n in _doubtful(child, deviation)]
        of_table, of_sections = (SAFETY * float(error) for error in np.max(changes, axis=0))
        currents = table.level_currents(self._most)
        if currents is None or not (of_table <= self._tolerance and of_sections <= SECTION_TOLERANCE):
            return None
        force, flux = table.at(*self.point)
        return table.numbers() | {
            "current": currents,
            "force": np.array(force),
            "flux_linkage": np.array(flux),
            "table_error": np.array(max(of_table, LEAST_ESTIMATE * self._tolerance)),
            "section_error": np.array(of_sections),
        }


def _member(field: MagnetField, off: float = 0.0) -> Member:
    return Member(FullField(field.model, [field.model.source]), off)


def _doubtful(child: Child, deviation: Deviation) -> Indices:
    """Where the cubature misses most, and a point that the deviation draws."""
    return np.unique([int(np.argmax(child.missed)), *_drawn(child, deviation, 1)])


def _drawn(child: Child, deviation: Deviation, count: int) -> Indices:
    seed = np.array([1.0, *deviation.values()]).view(np.uint32)
    return np.random.default_rng(seed).integers(child.missed.size, size=count)


class MadeTable:
    """The table of one made magnet, read from its reduced field."""

    def __init__(self, field: MagnetField, child: Child, nodes: Nodes) -> None:
        self.field, self.child, self.nodes = field, child, nodes
        vectors = child.model.basis.vectors
        self._cuts = [(cut, cut.along_x @ vectors, cut.along_y @ vectors) for cut in field.probes.cuts.values()]
        self._value, self._slope, self._means = self._criterion(child.states)

    def _criterion(self, states: ReducedStates) -> tuple[Array, Array, Array]:
        """(n,) T, the largest of the sections' means in the iron, its derivative along the current; all (cut, n)."""
        means, slopes = [], []
        c, along = states.states.T, states.by_current[:, 0].T
        for cut, x, y in self._cuts:
            iron = self.field.model.irons[cut.region].iron
            sheets, (slope,) = sheet_flux_density(iron, (x @ c, y @ c), [(x @ along, y @ along)])
            means.append(cut.weight @ sheets[1:-1])
            slopes.append(cut.weight @ slope[1:-1])
        largest = np.argmax(means, axis=0), np.arange(len(states.points))
        return np.stack(means)[largest], np.stack(slopes)[largest], np.stack(means)

    def changes(self, n: int) -> tuple[float, float]:
        """What a full step of Newton's changes at a node: force or flux linkage, and the sections' flux densities."""
        change, potential = self.child.step_from(n)
        found = self.field.probes.section_flux_density(potential)
        means = np.array([density.mean for density in found.values()])
        return change, float(np.abs(means - self._means[:, n]).max()) / self.nodes.levels[-1]

    def numbers(self) -> Arrays:
        """The table's force and flux linkage."""
        shape = len(self.nodes.gaps), len(self.nodes.currents)
        force, flux = self._force_and_flux(self.child.states)
        return {"table_force": force.reshape(shape), "table_flux_linkage": flux.reshape(shape)}

    def _force_and_flux(self, states: ReducedStates) -> tuple[Array, Array]:
        scale = self.field.probes.scale
        leakage = leaked(self.field.leakage, states.points.currents[:, 0])["flux_linkage"]
        return scale * states.energy_slope, scale * states.flux_linkage[:, 0] + leakage

    def at(self, current: float, gap: float) -> tuple[float, float]:
        """Force and flux linkage at a point, to whose gap the magnet's deviation adds."""
        states = self._solve(np.array([gap + self.child.member.off]), np.array([current]))
        force, flux = self._force_and_flux(states)
        return float(force[0]), float(flux[0])

    def _solve(self, gap: Array, current: Array) -> ReducedStates:
        points = FieldPoints(gap, current[:, None])
        return self.child.model.solve(points, self.child.states.near(points).states)

    def level_currents(self, most: float) -> Array | None:
        """(n_level, n_gap) A, the smallest that brings each level, nan where none up to `most` does.

        None where a level lies beyond the table's last current, and that below `most`. Newton's iteration on the
        current, kept between the nodes on either side of the level.
        """
        levels, currents = np.array(self.nodes.levels), np.r_[0.0, self.nodes.currents]
        value = self._value.reshape(len(self.nodes.gaps), -1)
        value = np.column_stack([np.zeros(len(value)), value])
        above = value[None] >= levels[:, None, None]  # (level, gap, node)
        reached = above.any(axis=2)
        if not reached.all() and currents[-1] < most:
            return None
        level_at, gap_at = np.nonzero(reached)
        node = np.argmax(above[level_at, gap_at], axis=1)
        low, high, wanted = currents[node - 1], currents[node], levels[level_at]
        share = (wanted - value[gap_at, node - 1]) / (value[gap_at, node] - value[gap_at, node - 1])
        gap = np.array(self.nodes.gaps)[gap_at] + self.child.member.off
        found = np.full(reached.shape, np.nan)
        found[level_at, gap_at] = self._roots(gap, wanted, low + share * (high - low), (low, high))
        return np.where(found > most, np.nan, found)

    def _roots(self, gap: Array, wanted: Array, guess: Array, bracket: tuple[Array, Array]) -> Array:
        low, high = (side.copy() for side in bracket)
        current = guess.copy()
        for _ in range(MOST_STEPS):
            value, slope, _ = self._criterion(self._solve(gap, current))
            step = (wanted - value) / slope
            if (np.abs(step) <= CURRENT_TOLERANCE * current).all():
                return np.asarray(current + step)
            below = value < wanted
            low, high = np.where(below, current, low), np.where(below, high, current)
            following = current + step
            inside = (low <= following) & (following <= high)
            current = np.where(inside, following, (low + high) / 2)
        raise NotConverged("the current of a level was not found in the reduced field; solve the fields in full")

"""Rows of a sweep (one gap, increasing currents) as a job's work; what names and describes the field they come from."""

import datetime
import platform
import time
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from msl_fem.actuator import MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.row_cache import Arrays, content_key
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.end_effects import METHOD as END_EFFECTS_METHOD
from msl_fem.magnetics.field.end_effects import NONE, EndEffects, KnownFactors
from msl_fem.magnetics.field.magnet_field import Accuracy, MagnetField, magnet_mesh
from msl_fem.magnetics.solver.magnetostatics import FieldSolution, NewtonSettings, solve_field
from msl_fem.magnetics.solver.prolongation import prolongation_map
from msl_fem.magnetics.sweep.expected_fields import ExpectedFields
from msl_fem.magnetics.sweep.predictor import RowPredictor
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.table.magnetic_table import EXTRAS, NODES, SECTION
from msl_fem.table.origin import MAGNET_DIGEST

SCALARS = (*NODES, *EXTRAS)
ROUGH = NewtonSettings(tolerance=1e-3)
"""Of a field that one with a degree more starts from, which is 1e-2 away."""
SOLVER_VERSION = 3
"""Raised when a change of the field solver changes its answers: cached rows of another version are not used."""


@dataclass(frozen=True)
class FieldJob:
    """What a process needs to make a magnet's field: the meshes' sizes are in the mesh already."""

    magnet: MagnetKind
    mesh: TriangleMesh
    folder: Path
    order: int
    end_effects: EndEffects = False
    accuracy: Accuracy = "normal"

    def mesh_at(self, gap: float) -> TriangleMesh:
        """The mesh of a gap, of a magnet whose gaps have their own."""
        return magnet_mesh(self.magnet, gap, self.accuracy)

    def field(self, refine: bool = False) -> MagnetField:
        """The field model of the job's degree, or of one more."""
        return MagnetField(
            self.magnet,
            self.mesh,
            folder=self.folder,
            order=self.order + refine,
            end_effects=self.end_effects,
            remesh=self.mesh_at if self.magnet.OWN_MESHES else None,
        )


@dataclass(frozen=True)
class SweepJob(FieldJob):
    """A job of `SweepRow`s; `expected` tells starts of refined ones, and no answers."""

    expected: ExpectedFields | None = None

    def solver(self) -> "RowSolver":
        """The solver of the job's rows."""
        return RowSolver(self)


@dataclass(frozen=True)
class SweepRow:
    """One gap (m) and its currents (A), increasing; `refine` solves with one polynomial degree more."""

    gap: float
    currents: tuple[float, ...]
    refine: bool = False

    @property
    def cost(self) -> int:
        """The work it is, in solutions of the base model."""
        return len(self.currents) * (4 if self.refine else 1)


class RowSolver:
    """Solves rows of a job; the model, unless it is given, and the refined one where needed are made once."""

    def __init__(self, job: SweepJob, field: MagnetField | None = None) -> None:
        self.job = job
        self._fields: dict[bool, MagnetField] = {} if field is None else {False: field}

    def field(self, refine: bool = False) -> MagnetField:
        """The field model of the job's degree, or of one more."""
        if refine not in self._fields:
            self._fields[refine] = self.field().refined() if refine else self.job.field()
        return self._fields[refine]

    @one_blas_thread
    def solve(self, row: SweepRow) -> Arrays:
        """Arrays (n_current,) of a row's quantities; a point that does not converge is nan, and named in `failed`.

        Along the row each field starts from where those before it lead, or a refined one from the plain one; a point
        that fails from there is tried once more from zero.
        """
        started = time.process_time()
        plain = self.field().near(row.gap)
        field = self.field(refine=True).near(row.gap) if row.refine else plain
        raised = prolongation_map(plain.model, field.model) if row.refine else None
        points: list[dict[str, float]] = []
        failed: list[str] = []
        predictor = RowPredictor()
        for current in row.currents:
            try:
                start = predictor.at(current) if raised is None else raised @ self._plain(plain, current, row.gap)
                solution = _solve_from(field, current, row.gap, start)
            except NotConverged:
                failed.append(f"{current:g} A at {row.gap * 1e3:g} mm")
                points.append({})
                predictor.forget()
                continue
            points.append(_numbers(field, solution))
            predictor.take(current, solution, field.slope(solution))
        names = dict.fromkeys(name for point in points for name in point)
        arrays = {name: np.array([point.get(name, np.nan) for point in points]) for name in names}
        arrays["cpu_seconds"] = np.array(time.process_time() - started)
        return arrays | ({"failed": np.array(failed)} if failed else {})

    def _plain(self, field: MagnetField, current: float, gap: float) -> Array:
        """A potential near that of the plain field."""
        if self.job.expected is not None:
            return self.job.expected.potential(gap, current)
        return solve_field(field.model, current, gap, settings=ROUGH).potential


def _solve_from(field: MagnetField, current: float, gap: float, start: Array | None) -> FieldSolution:
    """The solution from a start, or else from zero."""
    try:
        return field.solve(current, gap, start=start)
    except NotConverged:
        if start is None:
            raise
        return field.solve(current, gap)


def _numbers(field: MagnetField, solution: FieldSolution) -> dict[str, float]:
    quantities = field.quantities(solution)
    numbers = {name: float(getattr(quantities, name)) for name in SCALARS}
    numbers |= {SECTION + name: value.mean for name, value in quantities.flux_density.items()}
    return numbers | {"tail": float(bool(quantities.rests_on_tail)), "newton_iterations": len(solution.trail)}


def field_key(field: MagnetField, **more: object) -> str:
    """A name for all that determines a field's answers: geometry, irons' curves, mesh, degree, solver; and for `more`.

    A curve is told by its values, as a file of the same name may have changed.
    """
    probe = np.linspace(0.0, 3.0, 3001)
    mesh = field.model.mesh
    content = {
        "magnet": field.magnet.model_dump(),
        "irons": {name: iron.magnetise(probe)[0].tolist() for name, iron in field.irons.items()},
        "mesh": [mesh.gap, mesh.points.shape, mesh.points.sum(), field.order],
        "end_effects": f"{END_EFFECTS_METHOD} {field.ends}" if field.ends else "",
        "solver": SOLVER_VERSION,
    }
    return content_key(content | more)


def field_provenance(field: MagnetField, accuracy: Accuracy) -> dict[str, object]:
    """What a table or map from a field states of it: irons, mesh, end effects, versions and date."""
    libraries = ("msl-fem", "numpy", "scipy", "scikit-fem", "netgen-mesher", "qdldl")
    return {
        MAGNET_DIGEST: field.magnet.digest,
        "iron": {
            name: f"{iron.name}, stacking {iron.stacking_factor:g}: {iron.source}" for name, iron in field.irons.items()
        },
        "mesh": {
            "accuracy": accuracy,
            "degree": field.order,
            "triangles": field.model.mesh.triangles.shape[1],
            "unknowns": field.model.free.size,
            "gap_m": field.model.mesh.gap,
        },
        **stated_ends(field.magnet, field.ends),
        "versions": {"python": platform.python_version()} | {name: version(name) for name in libraries},
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
    }


def stated_ends(magnet: MagnetKind, ends: KnownFactors) -> dict[str, object]:
    """What provenance says of end effects: how they are corrected, by which factors, and what is left of the error."""
    if not ends:
        return {"end_effects": NONE}
    stated: dict[str, object] = {"end_effects": END_EFFECTS_METHOD, "end_factors": asdict(ends)}
    known = magnet.known_ends
    if ends != known.factors:
        return stated
    left = {"force": known.force_error, "flux_linkage": known.flux_error}
    return stated | {"end_effects": f"{END_EFFECTS_METHOD}; {known.source}", "end_effects_error": left}

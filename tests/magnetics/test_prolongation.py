"""Potentials taken over to other meshes and degrees, and the starts of both sides' fields that they give."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.magnetics.field.magnet_field import magnet_mesh
from msl_fem.magnetics.solver.prolongation import prolongation_map
from msl_fem.magnetics.sweep.expected_fields import expected_fields
from msl_fem.magnetics.sweep.pair_rows import PairSweepJob, PairSweepRow, alone_of, pair_job
from msl_fem.magnetics.sweep.pair_starts import PairStarts, mirror_map
from msl_fem.magnetics.sweep.reduced_rows import reduced_rows, reduced_side_rows
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow

POSITIONS, CURRENTS = np.linspace(-0.25e-3, 0.25e-3, 9), 4 * np.linspace(0, 1, 10) ** 1.5


@pytest.fixture(scope="module")
def servo() -> Actuator:
    return load_actuator(ROOT / "geometries/fast_tool_servo.toml")


@pytest.fixture(scope="module")
def job(servo: Actuator) -> PairSweepJob:
    return pair_job(servo, 0.6e-3 + POSITIONS, gap_sum=1.2e-3, accuracy="fast")


def test_what_a_coarse_mesh_can_say_is_taken_over_exactly(job: PairSweepJob) -> None:
    """A quadratic potential, from the coarse mesh to the accurate one and to one degree more."""
    coarse, accurate, refined = job.field(common=True).model, job.field().model, job.field(refine=True).model

    def quadratic(points: np.ndarray) -> np.ndarray:
        x, y = points / np.ptp(accurate.mesh.points[0])
        return 1 + 2 * x - y + 3 * x**2 - x * y + y**2

    for one, other in ((coarse, accurate), (accurate, refined)):
        found = prolongation_map(one, other) @ quadratic(one.basis.doflocs)
        np.testing.assert_allclose(found, quadratic(other.basis.doflocs), atol=1e-12)


def test_the_mirror_image_exchanges_the_sides(job: PairSweepJob) -> None:
    field = job.field()
    here, exchanged = field.solve(1e-4, 2.0, -0.7), field.solve(-1e-4, -0.7, 2.0)
    image = mirror_map(field) @ exchanged.potential
    np.testing.assert_allclose(image, here.potential, atol=1e-6 * np.abs(here.potential).max())


def test_a_start_of_both_lies_nearer_than_the_coarse_field(job: PairSweepJob) -> None:
    """In the energy norm, where the armature saturates too; checks of a row are what full rows say, in fewer steps."""
    field, common = job.field(), job.field(common=True)
    rows = [PairSweepRow(float(x), 0.0, tuple(CURRENTS.tolist())) for x in POSITIONS]
    reduced = reduced_side_rows(field, rows, "fast")
    assert reduced is not None
    asked = PairSweepRow(1e-4, 2.0, (-3.5, -1.0, 1.5), checked=True)
    known = expected_fields(reduced.model, alone_of([asked]))
    both, coarse = PairStarts(field, common, known), PairStarts(field, common, None)
    for current in asked.currents_2:
        exact = field.solve(asked.position, asked.current_1, current)

        def off(start: np.ndarray, exact=exact) -> float:
            away = start - exact.potential
            size = [float(v @ field.model.tangent.product(exact.tangent, v)) for v in (away, exact.potential)]
            return (size[0] / size[1]) ** 0.5

        where = asked.position, asked.current_1, current
        assert off(both.at(*where)) < 0.3 * off(coarse.at(*where)) < 0.1
    plain = replace(asked, checked=False)
    solver = replace(job, alone=known).solver()
    checked, full = solver.solve(asked), solver.solve(plain)
    assert checked["newton_iterations"].sum() < 0.6 * full["newton_iterations"].sum()
    for name in ("force", "flux_linkage_1", "flux_linkage_2"):
        assert checked[name] == pytest.approx(full[name], abs=1e-5 * np.abs(full[name]).max()), name
    raised, finer = solver.solve(replace(asked, refine=True)), job.field(refine=True)
    exact = finer.quantities(finer.solve(asked.position, asked.current_1, -1.0), (asked.current_1, -1.0))
    assert raised["force"][1] == pytest.approx(exact.force, rel=1e-5)
    assert raised["force"][1] != pytest.approx(checked["force"][1], rel=1e-5)


def test_a_refined_row_starts_from_the_plain_field(servo: Actuator) -> None:
    """From a reduced one, or else from a rough one; it is what the field of one degree more says."""
    magnet = servo.magnet_kind()
    gaps, currents = np.geomspace(2e-4, 1e-3, 7), 4 * np.linspace(0, 1, 10) ** 1.5
    job = SweepJob(magnet, magnet_mesh(magnet, 4.5e-4, "fast"), servo.folder, 2)
    reduced = reduced_rows(job.field(), [SweepRow(float(gap), tuple(currents.tolist())) for gap in gaps], "fast")
    assert reduced is not None
    row = SweepRow(float(gaps[2]), (float(currents[5]), float(currents[9])), refine=True)
    known = expected_fields(reduced.model, [(row.gap, current) for current in row.currents])
    finer = job.field(refine=True)
    exact = [finer.solve(current, row.gap) for current in row.currents]
    for solver in (RowSolver(replace(job, expected=known)), RowSolver(job)):
        found = solver.solve(row)
        assert found["newton_iterations"].sum() <= 0.7 * sum(len(one.trail) for one in exact)
        for n, current in enumerate(row.currents):
            force = finer.quantities(finer.solve(current, row.gap, start=exact[n].potential)).force
            assert found["force"][n] == pytest.approx(force, rel=1e-6)

"""A smooth error of the table: its size, its smoothness, and that force and flux stay derivatives of one coenergy."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosed import TABLE

from msl_fem.diagnosis.table_error import Visited, corrected, scaled, table_error
from msl_fem.errors import TableError
from msl_fem.maps import operating_map
from msl_fem.table import MagneticTable

VISITED = Visited((0.3, 1.2), (4.5e-4, 7.5e-4))


def test_the_corrected_table_is_what_the_lanes_take() -> None:
    error = table_error(TABLE, VISITED, tolerance=1e-3)
    numbers = np.random.default_rng(3).standard_normal(len(error.modes))
    table = corrected(TABLE, error, numbers, scale=1.002)
    surface = 1.002 * (TABLE.surface.coefficients + np.tensordot(numbers, error.modes, axes=1))
    assert table.surface.coefficients == pytest.approx(surface, rel=1e-7, abs=1e-9 * np.abs(surface).max())


def test_a_corrected_table_gives_a_map_as_the_believed_one_does() -> None:
    """Its flux densities are those believed, in proportion to the flux linkage."""
    error = table_error(TABLE, VISITED, tolerance=1e-3)
    table = corrected(TABLE, error, np.ones(len(error.modes)), scale=1.002)
    assert table.sections == TABLE.sections
    assert table.mesh_error == TABLE.mesh_error
    ratio = table.nodes["flux_linkage"][:, 1:] / TABLE.nodes["flux_linkage"][:, 1:]
    name = "flux_density_centre_leg"
    assert table.extras[name][:, 1:] == pytest.approx(ratio * TABLE.extras[name][:, 1:])
    assert operating_map(table, levels=(1.0,))
    twice = scaled(TABLE, 2.0)
    assert twice.extras[name] == pytest.approx(2 * TABLE.extras[name])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_of_an_error_with_which_it_is_no_table_the_largest_share_counts_with_which_it_is_one(sign: float) -> None:
    """A fit that lacks a cause may bend a table until its magnets repel: it is compared all the same."""
    error = table_error(TABLE, VISITED, tolerance=0.05)
    numbers = sign * 40.0 * np.ones(len(error.modes))

    def bent(share: float) -> MagneticTable:
        moves = {name: np.tensordot(numbers, error.nodes[name], axes=1) for name in error.nodes}
        return replace(TABLE, nodes={name: TABLE.nodes[name] + share * move for name, move in moves.items()})

    with pytest.raises(TableError):
        bent(1.0)
    found = corrected(TABLE, error, numbers, scale=1.0)
    moved = found.nodes["force"] - TABLE.nodes["force"]
    wanted = np.tensordot(numbers, error.nodes["force"], axes=1)
    share = float(moved.ravel() @ wanted.ravel() / (wanted.ravel() @ wanted.ravel()))
    assert share == pytest.approx(round(10 * share) / 10, abs=1e-9)
    assert 0.0 <= share < 1.0
    assert moved == pytest.approx(share * wanted, rel=1e-9, abs=1e-12)
    with pytest.raises(TableError):
        bent(share + 0.1)


def test_force_and_flux_stay_reciprocal() -> None:
    error = table_error(TABLE, VISITED, tolerance=0.05)
    table = corrected(TABLE, error, np.ones(len(error.modes)), scale=1.0)
    i, g, d = 0.7, 6e-4, 1e-5
    force_slope = (table.force(i + d, g) - table.force(i - d, g)) / (2 * d)
    flux_slope = (table.flux_linkage(i, g + 1e-8) - table.flux_linkage(i, g - 1e-8)) / 2e-8
    assert float(force_slope) == pytest.approx(-float(flux_slope), rel=1e-5)


def test_its_size_over_the_whole_table_is_the_tolerance() -> None:
    """With the whole table visited, the RMS relative error of force or flux over random draws is the tolerance."""
    everywhere = Visited((0.0, float(TABLE.current[-1])), (float(TABLE.gap[0]), float(TABLE.gap[-1])))
    error = table_error(TABLE, everywhere, tolerance=1e-3)
    chance, found = np.random.default_rng(4), []
    for _ in range(60):
        numbers = chance.standard_normal(len(error.modes))
        changes = {n: np.tensordot(numbers, error.nodes[n], axes=1)[:, 1:] for n in ("force", "flux_linkage")}
        found.append([float(np.mean((changes[n] / TABLE.nodes[n][:, 1:]) ** 2)) for n in changes])
    assert np.sqrt(np.max(np.mean(found, axis=0))) == pytest.approx(1e-3, rel=0.25)


def test_where_a_record_goes_an_error_of_another_kind_is_a_sum_of_modes() -> None:
    """A smooth factor that is not made of the modes: what they cannot follow is below a fiftieth of it."""
    i, g = (a.ravel() for a in np.meshgrid(np.linspace(0.3, 1.2, 12), np.linspace(4.5e-4, 7.5e-4, 12)))
    wanted = 1e-3 * np.cos(i / 2.5 + g / 4e-4)
    basis = factors(VISITED, i, g)
    numbers = np.linalg.lstsq(basis, wanted, rcond=None)[0]
    assert np.abs(basis @ numbers - wanted).max() < 2e-5


def factors(visited: Visited, i: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Relative change of the coenergy at currents and gaps by each mode of an error of 1e-3, (n_point, n_mode)."""
    error = table_error(TABLE, visited, tolerance=1e-3)
    coenergy = TABLE.evaluate(i, g)["coenergy"]
    tables = [corrected(TABLE, error, row, scale=1.0) for row in np.eye(len(error.modes))]
    return np.array([table.evaluate(i, g)["coenergy"] / coenergy - 1 for table in tables]).T


def test_an_error_is_as_probable_where_currents_are_small_as_where_they_are_large() -> None:
    """Of a wave of the same octaves, whose current is a quarter."""
    costs = []
    for top in (0.25, 1.0):
        high = top * float(TABLE.current[-1])
        i, g = (a.ravel() for a in np.meshgrid(np.geomspace(high / 4, high, 12), np.linspace(4.5e-4, 7.5e-4, 4)))
        wanted = 1e-3 * np.cos(2 * np.log(i / high))
        basis, noise = factors(Visited((high / 4, high), (4.5e-4, 7.5e-4)), i, g), 5e-5
        left = np.vstack([basis / noise, np.eye(basis.shape[1])])
        numbers = np.linalg.lstsq(left, np.concatenate([wanted / noise, np.zeros(basis.shape[1])]), rcond=None)[0]
        costs.append(float(numbers @ numbers + np.sum((basis @ numbers - wanted) ** 2) / noise**2))
    assert costs[0] < 3 * costs[1]

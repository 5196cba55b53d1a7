"""The magnetic table: its rectangle, its checks, its file."""

import contextlib
import dataclasses
import json
import sys

import numpy as np
import pytest
import xarray as xr
from conftest import closed_form_table

from msl_fem.errors import InputError, OutOfTable, TableError
from msl_fem.table.magnetic_table import NODES, MagneticTable, read_table, write_table


@pytest.fixture
def full(table) -> MagneticTable:
    """A table with every field set."""
    stress = {"force_stress_tensor": 1.001 * table.nodes["force"]}
    return dataclasses.replace(
        table,
        extras={**table.extras, **stress},
        mesh_error=1.25e-4,
        interpolation_error=3.5e-5,
        reciprocity_error=4.5e-5,
        provenance={"actuator": "test", "iron": {"core": "m19: µ"}, "notes": ["one", "two"]},
    )


def with_nodes(table: MagneticTable, **nodes: np.ndarray) -> MagneticTable:
    return dataclasses.replace(table, nodes={**table.nodes, **nodes})


# --- the rectangle ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("current", "gap", "words"),
    [
        (1.0, 3e-5, ("gap 30 µm", "0.05 ... 1.2 mm", "--gaps")),
        (1.0, 2e-3, ("gap 2 mm", "0.05 ... 1.2 mm")),
        (1.0, np.nan, ("gap nan", "0.05 ... 1.2 mm")),
        (12.5, 5e-4, ("current 12.5 A", "0 ... 12 A of either sign", "--currents")),
        (-12.5, 5e-4, ("current -12.5 A", "0 ... 12 A of either sign")),
        (np.nan, 5e-4, ("current nan", "0 ... 12 A of either sign")),
        (np.inf, 5e-4, ("current inf", "0 ... 12 A of either sign")),
    ],
)
def test_outside_names_the_rectangle_and_the_way_out(table, current, gap, words):
    for ask in (table.evaluate, table.force, table.flux_linkage):
        with pytest.raises(OutOfTable) as caught:
            ask(current, gap)
        for word in words:
            assert word in str(caught.value)
        assert isinstance(caught.value, InputError)


def test_one_point_outside_spoils_the_whole_request(table):
    with pytest.raises(OutOfTable, match=r"13 A"):
        table.force(np.array([1.0, 13.0, 2.0]), 5e-4)


def test_edges_belong_to_the_table(table):
    corners = table.evaluate(np.array([0.0, 12.0, -12.0]), np.array([[table.gap[0]], [table.gap[-1]]]))
    assert np.isfinite(corners["force"]).all()


def test_sections_are_named(table):
    assert table.sections == ("centre_leg", "yoke")


# --- checks -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda t: dataclasses.replace(t, gap=t.gap[::-1].copy()), "increasing"),
        (lambda t: dataclasses.replace(t, gap=t.gap - t.gap[0]), "positive"),
        (lambda t: dataclasses.replace(t, gap=np.where(t.gap > 1e-3, np.nan, t.gap)), "must be finite"),
        (lambda t: dataclasses.replace(t, current=np.where(t.current > 9, np.inf, t.current)), "must be finite"),
        (lambda t: dataclasses.replace(t, current=t.current + 1.0), "first current must be 0"),
        (lambda t: dataclasses.replace(t, current=t.current[:-1]), "expected"),
        (lambda t: dataclasses.replace(t, gap=t.gap[:1], nodes={k: v[:1] for k, v in t.nodes.items()}), "at least 2"),
        (
            lambda t: dataclasses.replace(t, nodes={k: v for k, v in t.nodes.items() if k != "force"}),
            "'force' is missing",
        ),
        (lambda t: with_nodes(t, force=t.nodes["force"].T[:3]), "'force' has shape"),
        (
            lambda t: with_nodes(t, force=np.where(t.nodes["force"] > 200, np.inf, t.nodes["force"])),
            "not finite at gap",
        ),
        (lambda t: with_nodes(t, flux_linkage=t.nodes["flux_linkage"] + 1e-3), "'flux_linkage' reaches 0.001 at i = 0"),
        (lambda t: with_nodes(t, force=t.nodes["force"] + 1.0), "'force' reaches 1 at i = 0"),
    ],
)
def test_contradictions_are_refused(table, change, word):
    with pytest.raises(TableError, match=word):
        change(table)


def test_extras_may_hold_what_is_not_known(table):
    unknown = {"flux_density_yoke": np.full(table.nodes["force"].shape, np.nan)}
    assert dataclasses.replace(table, extras=unknown).sections == ("yoke",)


# --- the file ---------------------------------------------------------------------------------------------------------


def test_round_trip_is_exact_to_the_bit(full, tmp_path):
    back = read_table(write_table(full, tmp_path / "deep" / "t.nc"))
    for name in ("gap", "current"):
        assert (getattr(back, name) == getattr(full, name)).all()
    for one, other in ((full.nodes, back.nodes), (full.extras, back.extras)):
        assert set(one) == set(other)
        assert all((one[name] == other[name]).all() for name in one)
    assert (back.surface.coefficients == full.surface.coefficients).all()
    for name in ("mesh_error", "interpolation_error", "reciprocity_error"):
        assert getattr(back, name) == getattr(full, name)
    assert back.provenance == full.provenance


def test_unknown_errors_stay_unknown(table, tmp_path):
    back = read_table(write_table(table, tmp_path / "t.nc"))
    assert np.isnan([back.mesh_error, back.interpolation_error, back.reciprocity_error]).all()


def test_a_table_is_written_and_read_without_xarray(full, tmp_path, monkeypatch):
    """Whose import, with what it imports in turn, takes longer than a small table; the file is the one it shows."""
    shown = full.to_xarray()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "xarray", None)
        back = read_table(write_table(full, tmp_path / "t.nc"))
    with xr.open_dataset(tmp_path / "t.nc", engine="h5netcdf") as data:
        assert data.identical(shown)
        assert all(variable.encoding["fletcher32"] for variable in data.variables.values())
    np.testing.assert_array_equal(back.nodes["force"], full.nodes["force"])


def test_file_names_units_interpolant_and_provenance(full, tmp_path):
    """What INTERFACE promises to any NetCDF reader."""
    with xr.open_dataset(write_table(full, tmp_path / "t.nc"), engine="h5netcdf") as data:
        assert data["force"].dims == ("gap", "current")
        units = {name: data[name].attrs["units"] for name in data.variables}
        assert all(data[name].attrs["long_name"] for name in data.variables)
        assert json.loads(data.attrs["provenance"])["iron"] == {"core": "m19: µ"}
        assert "spline" in data.attrs["interpolant"]
    assert units == {
        "gap": "m",
        "current": "A",
        "coenergy": "J",
        "flux_linkage": "Wb",
        "force": "N",
        "incremental_inductance": "H",
        "force_current_slope": "N/A",
        "force_gap_slope": "N/m",
        "force_stress_tensor": "N",
        "flux_density_centre_leg": "T",
        "flux_density_yoke": "T",
    }


def foreign(full: MagneticTable, tmp_path, change) -> None:
    """The file tmp_path/t.nc as another program might write it."""
    with xr.open_dataset(write_table(full, tmp_path / "own.nc"), engine="h5netcdf") as data:
        change(data.load()).to_netcdf(tmp_path / "t.nc", engine="h5netcdf")


def in_units(data: xr.Dataset, name: str, unit: str) -> xr.Dataset:
    data[name].attrs["units"] = unit
    return data


def without_attributes(data: xr.Dataset) -> xr.Dataset:
    data.attrs = {}
    for name in data.variables:
        data[name].attrs = {}
    return data


def test_foreign_file_without_attributes_in_another_order_is_read(full, tmp_path):
    foreign(full, tmp_path, lambda data: without_attributes(data.transpose("current", "gap")))
    back = read_table(tmp_path / "t.nc")
    assert all((back.nodes[name] == full.nodes[name]).all() for name in NODES)
    assert back.provenance == {}


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda d: d.drop_vars("force"), "'force' is missing"),
        (lambda d: d.drop_vars("gap"), "gap"),
        (lambda d: d.rename(gap="luftspalt"), "gap"),
        (lambda d: d.assign(coenergy=d["coenergy"].isel(gap=0)), "coenergy|gap"),
        (lambda d: d.assign(coenergy=d["coenergy"] * np.nan), "not finite"),
        (lambda d: d.isel(gap=slice(None, None, -1)), "increasing"),
        (lambda d: d.assign_attrs(schema=2), "schema 2"),
        (lambda d: d.assign_attrs(provenance="{half"), "not a magnetic table"),
        (lambda d: in_units(d, "gap", "mm"), "'gap' is in 'mm', expected 'm'"),
        (lambda d: in_units(d, "force", "kN"), "'force' is in 'kN', expected 'N'"),
        (lambda d: xr.Dataset({"temperature": ("time", [1.0, 2.0])}), "not a magnetic table"),
    ],
)
def test_foreign_file_that_is_no_table_is_one_error(full, tmp_path, change, word):
    foreign(full, tmp_path, change)
    with pytest.raises(TableError, match=word) as caught:
        read_table(tmp_path / "t.nc")
    assert str(caught.value).startswith(str(tmp_path / "t.nc"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.6, 0.95])
def test_truncated_file_is_one_error(full, tmp_path, share):
    path = write_table(full, tmp_path / "t.nc")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(TableError, match=r"t\.nc"):
        read_table(path)


@pytest.mark.parametrize("seed", range(16))
def test_damaged_file_is_one_error_or_the_same_table(full, tmp_path, seed):
    """Bytes overwritten at random: refused with one error, unless they hit nothing that matters."""
    path = write_table(full, tmp_path / "t.nc")
    content, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    start = int(rng.integers(0, len(content) - 400))
    content[start : start + 400] = rng.bytes(400)
    path.write_bytes(bytes(content))
    with contextlib.suppress(TableError):
        back = read_table(path)
        assert all((back.nodes[name] == full.nodes[name]).all() for name in NODES)
        assert (back.gap == full.gap).all()
        assert (back.current == full.current).all()


def test_damaged_values_are_noticed(full, tmp_path):
    """A checksum guards every array: one flipped bit of a force is one error, not another force."""
    path = write_table(full, tmp_path / "t.nc")
    content = bytearray(path.read_bytes())
    at = bytes(content).index(full.nodes["force"].tobytes()[800:840])
    content[at + 3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(TableError, match="not a magnetic table"):
        read_table(path)


@pytest.mark.parametrize("content", [b"", b"gap,current,force\n1,2,3\n", bytes(range(256)) * 20])
def test_file_of_another_kind_is_one_error(tmp_path, content):
    (tmp_path / "t.nc").write_bytes(content)
    with pytest.raises(TableError, match="not a magnetic table"):
        read_table(tmp_path / "t.nc")


def test_missing_file_says_how_to_make_one(tmp_path):
    with pytest.raises(TableError, match=r"no such file.*msl-fem table"):
        read_table(tmp_path / "none.nc")
    with pytest.raises(TableError, match="is no file"):
        read_table(tmp_path)


def test_interrupted_write_leaves_the_old_file_whole(full, tmp_path, monkeypatch):
    path = write_table(full, tmp_path / "t.nc")
    before = path.read_bytes()

    def interrupted(variables, attributes, partial):
        partial.write_bytes(b"half a file")
        raise KeyboardInterrupt

    monkeypatch.setattr("msl_fem.table.magnetic_table.write_variables", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_table(closed_form_table(n_gap=4), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["t.nc"]


def test_table_that_cannot_be_written_is_an_input_error(full, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.nc").mkdir()
    for target in (tmp_path / "file" / "t.nc", tmp_path / "folder.nc"):
        with pytest.raises(InputError, match="cannot be written"):
            write_table(full, target)


def test_it_names_itself_in_a_line_and_becomes_a_data_set(table) -> None:
    said = repr(table)
    assert said.startswith("MagneticTable(")
    assert "\n" not in said
    assert len(said) < 160
    data = table.to_xarray()
    assert data["force"].attrs["units"] == "N"
    assert data["force"].sel(current=table.current[-1], gap=table.gap[0]) == table.nodes["force"][0, -1]
    assert data.attrs["interpolant"] == "C3 quintic Hermite coenergy spline"

"""The script that builds a Simulink model: its diagram, read and integrated here, is the magnet's circuit."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator
from scipy.io import loadmat

from msl_fem.errors import InputError
from msl_fem.export import simulink

RESISTANCE = 1.8
INPUTS = {"In1": 0, "Integrator": 1, "Gain": 1, "Product": 2, "Sum": 3, "Out1": 1, "2-D Lookup Table": 2}


@pytest.fixture(scope="module")
def written(table, tmp_path_factory):
    target = tmp_path_factory.mktemp("simulink") / "magnet.m"
    files = simulink.write(table, target)
    assert [f.name for f in files] == ["magnet.m", "magnet_table.mat"]
    return target.read_text(), loadmat(files[1])


def diagram(text):
    """Block to (kind, parameters), and (block, port) to the block that feeds it; each port is fed once."""
    blocks = {}
    for kind, name, rest in re.findall(r"^block\('simulink/[^/]+/([^']+)', '(\w+)'(?:, (.*))?\);$", text, re.M):
        blocks[name] = (kind, rest)
    for name in re.findall(r"^table\('(\w+)'\);$", text, re.M):
        blocks[name] = ("2-D Lookup Table", "")
    wires = [(a, b, int(p)) for a, b, p in re.findall(r"^wire\('(\w+)', '(\w+)', (\d)\);$", text, re.M)]
    for name, (kind, _) in blocks.items():
        if kind == "2-D Lookup Table":  # the script wires both of each
            wires += [("current", name, 1), ("gap", name, 2)]
    fed = {(to, port): source for source, to, port in wires}
    assert len(fed) == len(wires)
    assert set(fed) == {(name, k + 1) for name, (kind, _) in blocks.items() for k in range(INPUTS[kind])}
    assert set(fed.values()) | {n for n, (kind, _) in blocks.items() if kind == "Out1"} == set(blocks)
    return blocks, fed


def value_of(name, blocks, fed, known, data):
    """What a block gives."""
    if name in known:
        return known[name]
    kind, rest = blocks[name]
    given = [value_of(fed[name, k + 1], blocks, fed, known, data) for k in range(INPUTS[kind])]
    if kind == "2-D Lookup Table":
        known[name] = data[name](given).item()
    elif kind == "Gain":
        assert rest == "'Gain', num2str(resistance, 17)"
        known[name] = RESISTANCE * given[0]
    elif kind == "Product":
        known[name] = given[0] * given[1] if "'**'" in rest else given[0] / given[1]
    elif kind == "Sum":
        signs = re.search(r"'([+-]+)'", rest)[1]
        known[name] = sum(v if s == "+" else -v for s, v in zip(signs, given, strict=True))
    else:
        known[name] = given[0]
    return known[name]


def test_the_diagram_is_the_circuit(written, table):
    """6 V switched off again while the gap moves: the current of the blocks beside that of the table's own surface."""
    text, data = written
    blocks, fed = diagram(text)
    axes = data["current"].ravel(), data["gap"].ravel()
    read = {name: RegularGridInterpolator(axes, data[name]) for name in simulink.LOOKED_UP}

    def state(t):
        return {"voltage": 6.0 if t < 0.03 else -6.0, "gap": 0.6e-3 + 2e-4 * np.sin(150 * t),
                "gap_velocity": 0.03 * np.cos(150 * t)}  # fmt: skip

    def by_blocks(t, i):
        return [value_of(fed["current", 1], blocks, fed, state(t) | {"current": i[0]}, read)]

    def by_table(t, i):
        s = state(t)
        own = {name: float(v) for name, v in table.evaluate(i[0], s["gap"]).items()}
        flux_falls = own["force_current_slope"] * s["gap_velocity"]
        return [(s["voltage"] - RESISTANCE * i[0] + flux_falls) / own["incremental_inductance"]]

    runs = [solve_ivp(f, (0, 0.06), [0.0], max_step=5e-4, rtol=1e-6, t_eval=np.linspace(0, 0.06, 61)).y[0]
            for f in (by_blocks, by_table)]  # fmt: skip
    assert runs[1].max() > 1.0 > 0.0 > runs[1].min()
    assert np.abs(runs[0] - runs[1]).max() < 1e-3 * np.abs(runs[1]).max()
    at = state(0.01) | {"current": 2.0}
    for name in ("force", "flux_linkage"):
        wanted = float(table.evaluate(2.0, at["gap"])[name])
        assert value_of(f"{name}_out", blocks, fed, dict(at), read) == pytest.approx(wanted, rel=2e-3)


def test_the_matrices_hold_both_signs(written, table):
    _, data = written
    for name, sign in (("force", 1), ("flux_linkage", -1), ("incremental_inductance", 1), ("force_current_slope", -1)):
        np.testing.assert_array_equal(data[name][::-1], sign * data[name], err_msg=name)
    middle = data["current"].size // 2
    np.testing.assert_array_equal(data["current"].ravel()[middle::4], table.current)
    np.testing.assert_allclose(data["force"][middle::4, ::4], table.nodes["force"].T, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["a-b.m", "1a.m", "magnet.txt"])
def test_a_name_that_matlab_cannot_call_is_refused(table, tmp_path, name):
    with pytest.raises(InputError, match=r"a function of MATLAB is a file like magnet\.m"):
        simulink.write(table, tmp_path / name)
    assert not list(tmp_path.iterdir())

"""The guard's C header compiles without a warning and equals Python to the last bit, and no map breaks out of it."""

import dataclasses
import platform
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_programs import READ_AND_WRITE, VARIANTS, any_doubles, assert_same_bits, compile_c, compiler, run_pairs

from msl_fem.errors import InputError
from msl_fem.export.c_guard import guard_check_points, guard_header, write
from msl_fem.export.c_text import c_number
from msl_fem.maps import Guard, OperatingMap, operating_map

DOCUMENT = Path(__file__).parent.parent.parent / "docs" / "guard.md"
N_POINTS = 1_000_000
JUDGE = """
enum { n_out = 3 + M_GUARD_LEVELS };
static int self_check(void) { return m_guard_self_check(); }
static void judge(double current, double gap, double out[n_out])
{
    int k;
    out[0] = (double)m_guard_region(current, gap);
    out[1] = (double)m_guard_reason(current, gap);
    out[2] = m_guard_margin(current, gap);
    for (k = 0; k < M_GUARD_LEVELS; ++k)
        out[3 + k] = m_guard_limit(k, gap);
}
"""
SOURCE = READ_AND_WRITE.replace("/* doubles", JUDGE + "/* doubles")


@pytest.fixture(scope="module")
def example(table) -> OperatingMap:
    """A map with a level that is not reached everywhere."""
    return operating_map(table, levels=(0.8, 1.2, 1.9))


@pytest.fixture(scope="module")
def rough() -> OperatingMap:
    """A map of many irregular gaps and jumping currents, so that rounding shows, with lines that are negative."""
    rng, n = np.random.default_rng(13), 400
    gap, first = np.sort(rng.uniform(1e-5, 2e-3, n)), rng.uniform(0.1, 4.0, n)
    return OperatingMap(
        levels=np.array([1.0, 1.5]),
        gap=gap,
        current=np.array([first, first + rng.uniform(0, 4, n)]),
        section=(("yoke",) * n,) * 2,
        error=np.zeros((2, n)),
        allowance=np.full((2, n), 0.2),
        current_max=8.0,
    )


def hard_points(guard: Guard, n: int) -> tuple[np.ndarray, np.ndarray]:
    """(n,) currents and gaps: over the map and beyond, on and beside its lines and nodes, of random bits."""
    rng, gap_nodes = np.random.default_rng(11), guard.arrays.gap
    low, high, end = gap_nodes[0], gap_nodes[-1], guard.arrays.current_max
    gap = rng.uniform(0.9 * low, 1.05 * high, n)
    gap[::4] = rng.choice(np.r_[np.nextafter(gap_nodes, 0), gap_nodes, np.nextafter(gap_nodes, 1)], gap[::4].size)
    current = rng.uniform(-1.05 * end, 1.05 * end, n)
    lines = guard.limit(gap[1::4])
    on_line = lines[rng.integers(0, lines.shape[0], lines.shape[1]), np.arange(lines.shape[1])]
    current[1::4] = rng.choice([-1.0, 1.0], on_line.size) * np.nextafter(
        on_line, rng.choice([0.0, np.inf], on_line.size)
    )
    current[::10], gap[5::20] = any_doubles(rng, current[::10].size), any_doubles(rng, gap[5::20].size)
    fixed = guard_check_points(guard)
    current[: fixed[0].size], gap[: fixed[1].size] = fixed
    return current, gap


@pytest.fixture(scope="module", params=["example", "rough"])
def judged(request):
    """A map, hard points, and what Python says of them: (header, currents, gaps, answers as the program's rows)."""
    of: OperatingMap = request.getfixturevalue(request.param)
    guard = Guard(of)
    current, gap = hard_points(guard, N_POINTS)
    regions, reasons = guard.regions(current, gap), guard.reasons(current, gap)
    assert set(regions) == {0, 1, 2}
    assert set(reasons) == set(range(7))
    answers = np.vstack([regions, reasons, guard.margin(current, gap), guard.limit(gap)])
    return guard_header(of, name="m"), current, gap, answers


@pytest.mark.parametrize("variant", VARIANTS)
def test_c_says_the_same_as_python_to_the_last_bit(judged, variant, tmp_path):
    header, current, gap, answers = judged
    (tmp_path / "exported.h").write_text(header)
    found = run_pairs(compile_c(tmp_path, SOURCE, variant), current, gap, len(answers))
    np.testing.assert_array_equal(found[:, :2].T, answers[:2])
    assert_same_bits(found[:, 2:].T, answers[2:])


def test_the_self_check_sees_one_bit_in_a_table(example, tmp_path):
    """What a wrong compiler or a damaged flash would do."""
    header = guard_header(example, name="m")
    limit = Guard(example).arrays.limit[0, 0]
    damaged = header.replace(c_number(limit), c_number(np.nextafter(limit, 0)), 1)
    assert damaged != header
    (tmp_path / "exported.h").write_text(damaged)
    program = compile_c(tmp_path, SOURCE, "gcc -O0")
    assert subprocess.run([program], input=b"", check=False).returncode != 0


REFUSED = {"-ffast-math": "compile without -ffast-math", "-ffinite-math-only": "compile without -ffast-math"}
if platform.machine() == "x86_64":
    REFUSED["-mfpmath=387"] = "rounds to double after each operation"


@pytest.mark.parametrize("flag", REFUSED)
def test_flags_that_change_the_arithmetic_are_refused(example, tmp_path, flag):
    (tmp_path / "exported.h").write_text(guard_header(example, name="m"))
    (tmp_path / "program.c").write_text(SOURCE)
    command = [compiler("gcc"), "-std=c99", "-O2", flag, "-o", tmp_path / "program", tmp_path / "program.c"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert REFUSED[flag] in done.stderr


def test_arithmetic_of_16_bits_beside_that_of_doubles_is_let_pass(example, tmp_path):
    """What gcc says of a processor that has it where -march=native is given."""
    (tmp_path / "exported.h").write_text(guard_header(example, name="m"))
    (tmp_path / "program.c").write_text(
        "#include <float.h>\n#if FLT_EVAL_METHOD == 16\n#warning of 16\n#endif\n" + SOURCE
    )
    command = [compiler("gcc"), "-std=gnu17", "-O2", "-mavx512fp16", "-o", tmp_path / "program", tmp_path / "program.c"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "unrecognized" in done.stderr:
        pytest.skip("this gcc knows no such processor")
    assert done.returncode == 0, done.stderr[:3000]
    assert "of 16" in done.stderr


HOSTILE = (
    "*/ int evil; /*", "*\\\n/ int evil;", "*??/\n/ int evil;", "x\n#define evil", '"); evil("', "é\u2028evil", "int",
    "9", "${evil} {{ evil }} {% raw %}", "*" + "/" * 5000 + " int evil;",
)  # fmt: skip


@pytest.mark.parametrize("text", HOSTILE)
def test_no_text_of_a_map_becomes_code(example, tmp_path, text):
    """Trigraphs count under -std=c99."""
    hostile = dataclasses.replace(example, actuator=text, digest=text, warnings=(text, "\n" + text))
    object.__setattr__(hostile, "criterion", text)  # past the record's own check
    header = guard_header(hostile)
    (tmp_path / "exported.h").write_text(header)
    (tmp_path / "program.c").write_text('#include "exported.h"\nint main(void) { return 0; }\n')
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    command = [compiler("gcc"), *strict, "-E", "-P", tmp_path / "program.c"]
    code = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "evil;" not in code
    assert "evil(" not in code
    subprocess.run([compiler("gcc"), *strict, "-fsyntax-only", tmp_path / "program.c"], check=True)
    names = {line.split("(")[0].split()[-1] for line in header.splitlines() if line.startswith("static inline")}
    assert len(names) == 12


def test_the_header_says_where_it_comes_from(example):
    header = guard_header(dataclasses.replace(example, actuator="Some Magnet", digest="ab12"))
    comment = header.split("*/")[0]
    for said in ("Some Magnet", "ab12", "0.8 T, 1.2 T, 1.9 T", "mean", "5e-05 m to 0.0012 m", "12 A", "msl_fem 0"):
        assert said in comment
    assert "some_magnet_guard_region" in header
    assert "SOME_MAGNET_GUARD_UNACCEPTABLE" in header
    assert header.isascii()
    assert header == guard_header(dataclasses.replace(example, actuator="Some Magnet", digest="ab12"))


def test_two_guards_in_one_program(example, table, tmp_path):
    other = operating_map(table, levels=(1.2,), gap=table.gap[[3, 9]])
    (tmp_path / "one.h").write_text(guard_header(example, name="one"))
    (tmp_path / "two.h").write_text(guard_header(other, name="two"))
    source = '#include "one.h"\n#include "two.h"\n#include "one.h"\n'
    source += "int main(void) { return one_guard_self_check() + two_guard_self_check(); }\n"
    assert subprocess.run([compile_c(tmp_path, source, "gcc -O2")], check=False).returncode == 0


def test_the_example_of_the_documentation_cuts_as_it_says(example, tmp_path):
    (code,) = re.findall(r"```c\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "guard.h").write_text(guard_header(example, name="fast_tool_servo"))
    source = READ_AND_WRITE.replace("exported.h", "guard.h").replace(
        "/* doubles",
        f"""
enum {{ n_out = 1 }};
static int self_check(void) {{ return fast_tool_servo_guard_self_check(); }}
{code.replace("double allowed", "static double allowed")}
static void judge(double current, double gap, double *out) {{ out[0] = allowed(current, gap); }}
/* doubles""",
    )
    current, gap = np.array([0.1, -30, np.nan, 0.1, np.inf, -np.inf]), np.array([3e-4, 3e-4, 3e-4, 1.0, 3e-4, np.nan])
    last = Guard(example).limit(3e-4)[-1]
    found = run_pairs(compile_c(tmp_path, source, "gcc -O2"), current, gap, 1)
    assert found.ravel().tolist() == [0.1, -last, 0.0, 0.0, last, 0.0]


def test_the_file_is_written_whole_or_not_at_all(example, tmp_path):
    assert write(example, tmp_path / "new" / "guard.h") == (tmp_path / "new" / "guard.h",)
    assert (tmp_path / "new" / "guard.h").read_text() == guard_header(example)
    with pytest.raises(InputError, match="--name"):
        write(example, tmp_path / "bad.h", name="Bad Name")
    assert not (tmp_path / "bad.h").exists()

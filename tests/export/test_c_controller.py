"""The controller's C header steps as Python does, to the last bit, also as a processor in the loop; any design."""

import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from c_programs import VARIANTS, assert_same_bits, compile_c
from servo_controllers import TABLE, delayed_design, servo, servo_design, servo_map

from msl_fem.control.both_sides import BothSides
from msl_fem.control.controller import N_PREFERRED, N_VIOLATION, controller_state, controller_step
from msl_fem.control.design import ControllerDesign
from msl_fem.control.heat import thermal_guard
from msl_fem.control.output_stage import BIAS, INVERSE, OutputStage
from msl_fem.control.shared_force import SharedForce
from msl_fem.control.stepper import Stepper, reference_rows
from msl_fem.errors import InputError
from msl_fem.export.c_controller import ControllerSource, controller_header, write
from msl_fem.maps.pair_guard import PairGuardArrays
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.plant.plant import Surface
from msl_fem.plant.sampled_plant import simulate_closed

BOARD = r"""
#include <stdio.h>
#include "exported.h"
/* a processor in the loop: reference with its derivatives, now and later, and reading in; commands out */
int main(void)
{
    m_controller c;
    double in[7], out[2];
    if (m_controller_self_check() || m_guard_self_check())
        return 3;
    m_controller_start(&c);
    while (fread(in, sizeof in[0], 7, stdin) == 7) {
        m_controller_step_ahead(&c, in, in[6], out);
        if (fwrite(out, sizeof out[0], 2, stdout) != 2 || fflush(stdout))
            return 2;
    }
    fprintf(stderr, "%lu %lu %lu %lu %lu", c.preferred, c.discouraged, c.force_limited, c.heat_limited, c.violation);
    return 0;
}
"""


def pair_limits() -> np.ndarray:
    """(2, 2, 9, 7) A of a pair whose armature bears less, the more the other side carries, to nothing at all."""
    toward, other = np.linspace(-1, 1, 9)[:, None], np.linspace(0, 1, 7)
    bears = 4.0 - 1.5 * toward - 5.0 * other
    return np.stack([[0.7 * bears, bears], [0.8 * bears, bears + 0.4]])


SHARED = SharedForce(-4e-4, -90.0, 4 / 8e-4, 6 / 180.0, np.random.default_rng(8).normal(0, 1.5, (5, 7)))
BOTH = BothSides(PairGuardArrays(-4e-4, 0.0, 4e-4, 6.0, 8 / 8e-4, 1.0, pair_limits()), 0)


def program(design: ControllerDesign, folder: Path, variant: str = "gcc -O2") -> Path:
    """The compiled board of a design."""
    (folder / "exported.h").write_text(controller_header(ControllerSource(design, servo_map()), name="m"))
    return compile_c(folder, BOARD, variant, "-Wl,--no-as-needed", "-lm")  # sqrt, named before the source


LEARNED = r"""
#include <stdio.h>
#include "exported.h"
int main(void)
{
    unsigned long k;
    for (k = 0; k < 7; ++k)
        if (fwrite(m_controller_learned(k), sizeof(double), 6, stdout) != 6)
            return 2;
    return 0;
}
"""


def test_a_learned_reference_stands_in_the_header_and_repeats(tmp_path: Path) -> None:
    rows = np.random.default_rng(4).standard_normal((5, 6))
    text = controller_header(ControllerSource(servo_design(), servo_map(), rows), name="m")
    (tmp_path / "exported.h").write_text(text)
    board = compile_c(tmp_path, LEARNED, "gcc -O2", "-Wl,--no-as-needed", "-lm")
    told = np.frombuffer(subprocess.run([board], capture_output=True, check=True).stdout).reshape(-1, 6)
    assert_same_bits(told, rows[np.arange(7) % 5])


def answers(board: Path, wanted: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Commands (n, 2) of the board for references (n, 6) and readings (n,), and its counts."""
    given = np.column_stack([wanted, measured]).tobytes()
    done = subprocess.run([board], input=given, capture_output=True, check=False)
    assert done.returncode == 0, f"self-check or pipe: {done.returncode}"
    return np.frombuffer(done.stdout).reshape(-1, 2), [int(word) for word in done.stderr.split()]


def python_answers(design: ControllerDesign, wanted: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, list[int]]:
    state, made = controller_state(design.parameters), np.zeros((measured.size, 2))
    for k in range(measured.size):
        controller_step(design.parameters, state, wanted[k], float(measured[k]), made[k])
    return made, state[N_PREFERRED : N_VIOLATION + 1].astype(int).tolist()


def rough_run(design: ControllerDesign) -> tuple[np.ndarray, np.ndarray]:
    """References and readings that have nothing to do with one another: within the reach and beyond the map."""
    rng, n, span = np.random.default_rng(5), 4000, 0.5 * (design.reach[1] - design.reach[0])
    wanted = np.column_stack([
        span * rng.uniform(-1, 1, n), 0.1 * rng.standard_normal(n), 30 * rng.standard_normal(n),
        span * rng.uniform(-1, 1, n), 0.1 * rng.standard_normal(n), 30 * rng.standard_normal(n),
    ])  # fmt: skip
    slow = np.convolve(rng.standard_normal(n + 50), np.ones(50) / 7, mode="valid")[:n]
    measured = span * np.clip(slow, -1.8, 1.8)
    measured[200:300] = span * rng.uniform(-1.5, 1.5, 100)  # what is to come leaves the map, what is now does not
    measured[100:110] = [0.0, -0.0, 1e-300, span, -span, 2.0, -2.0, 1e-3, 0.0, 0.0]
    return wanted, measured


def changed(design: ControllerDesign, **parameters: object) -> ControllerDesign:
    return replace(design, parameters=design.parameters._replace(**parameters))


@cache
def designs() -> dict[str, ControllerDesign]:
    """Every branch of the template: laws, stages, delays, sides, two surfaces."""
    plain = servo_design()
    inverse = plain.parameters.inverse
    weaker = Surface(*(np.array(a) for a in inverse.surface_1[:3]))
    weaker = weaker._replace(coefficients=0.8 * weaker.coefficients)
    shape = np.array([1.1, -0.3, 0.2, -0.4, 0.15])
    soon = thermal_guard(plain.actuator, 0.2)  # warms 500 times faster
    assert soon is not None
    heating = soon.arrays
    factors = np.outer([1.0, 1.3, 0.7], np.ones(7)) ** np.arange(1, 8)
    return {
        "two degrees of freedom": plain,
        "integral alone": servo_design(feedforward=False),
        "no delay, no lag": delayed_design(0, ideal_drive=True),
        "three periods late": delayed_design(3),
        "shaped, with references": changed(
            plain, feedforward=False, shape=shape, reference_gain=np.array([1e4, -30.0, 0.4]), cubic=2e11
        ),
        "gravity, negative gain": changed(plain, constant_force=-9.0, integral_gain=-500.0, shape=shape),
        "overlap": changed(plain, stage=OutputStage(INVERSE, 8.0, 0.0, 1.0)),
        "a shared overlap": changed(plain, stage=OutputStage(INVERSE, 8.0, 0.0, 1.0, SHARED)),
        "about a bias": changed(plain, stage=OutputStage(BIAS, 0.0, 0.7, 75.0)),
        "one side": changed(plain, inverse=inverse._replace(sides=1)),
        "gains that follow": changed(plain, schedule_at=np.array([0.0, 2e5, 6e5]), schedule=factors),
        "two surfaces": changed(plain, inverse=inverse._replace(surface_2=weaker, gap_2=6.1e-4)),
        "judged together": changed(
            plain, inverse=inverse._replace(both=BOTH, gap_2=6.1e-4), stage=OutputStage(INVERSE, 8.0, 0.0, 1.0)
        ),
        "in the heat": changed(plain, thermal=heating, stage=OutputStage(INVERSE, 8.0, 0.0, 1.0)),
        "a bias in the heat": changed(plain, thermal=heating, stage=OutputStage(BIAS, 0.0, 0.7, 75.0)),
        "a bias judged together": changed(
            plain, inverse=inverse._replace(both=BOTH._replace(relation=1)), stage=OutputStage(BIAS, 0.0, 1.7, 75.0)
        ),
    }


NAMES = (
    "two degrees of freedom", "integral alone", "no delay, no lag", "three periods late", "shaped, with references",
    "gravity, negative gain", "overlap", "a shared overlap", "about a bias", "one side", "gains that follow",
    "two surfaces", "judged together", "in the heat", "a bias in the heat", "a bias judged together",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_every_design_steps_as_python_does_to_the_last_bit(name: str, tmp_path: Path) -> None:
    made = designs()
    assert tuple(made) == NAMES
    design = made[name]
    wanted, measured = rough_run(design)
    found, counts = answers(program(design, tmp_path), wanted, measured)
    expected, python_counts = python_answers(design, wanted, measured)
    assert_same_bits(found, expected)
    assert counts == python_counts
    assert counts[0] > 0
    assert counts[4] > 0, "beyond the guard too"
    assert (counts[3] > 0) == ("heat" in name)
    if "bias" not in name:
        assert (np.ptp(found, axis=0) > 0).sum() == (1 if name == "one side" else 2)


@pytest.fixture(scope="module")
def usual() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """References, readings and Python's commands of the usual design."""
    wanted, measured = rough_run(servo_design())
    return wanted, measured, python_answers(servo_design(), wanted, measured)[0]


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_compiler_gives_the_same_bits(
    variant: str, usual: tuple[np.ndarray, np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    wanted, measured, commands = usual
    found, _ = answers(program(servo_design(), tmp_path, variant), wanted, measured)
    assert_same_bits(found, commands)


def test_what_is_no_number_gives_no_current_in_both(tmp_path: Path) -> None:
    wanted, measured = (part[:200] for part in rough_run(servo_design()))
    measured[7], measured[9] = np.nan, np.inf
    found, counts = answers(program(servo_design(), tmp_path), wanted, measured)
    expected, python_counts = python_answers(servo_design(), wanted, measured)
    assert_same_bits(found, expected)
    assert counts == python_counts
    assert (found[7] == 0).all()
    assert (found[10:] != 0).any(), "the filter has gone on with its prediction"


class Board:
    """The compiled controller at the other end of two pipes, asked like any controller of a loop."""

    rate, delay_samples, current_loop_rate = 2500.0, 1, None

    def __init__(self, path: Path) -> None:
        self.path, self.process = path, None

    def start(self) -> None:
        self.stop()
        pipe = subprocess.PIPE
        self.process = subprocess.Popen([self.path], stdin=pipe, stdout=pipe, stderr=pipe)

    def rows(self, samples: np.ndarray, *, period: float) -> np.ndarray:
        return reference_rows(servo_design(), samples, period=period)

    def command(self, reference: np.ndarray, measured: float) -> np.ndarray:
        self.process.stdin.write(np.append(reference, measured).tobytes())
        self.process.stdin.flush()
        return np.frombuffer(self.process.stdout.read(16))

    def voltage(self, wanted: np.ndarray, read: np.ndarray, measured: float) -> np.ndarray:
        raise NotImplementedError("this one drives currents")

    def stop(self) -> None:
        if self.process is not None:
            self.process.communicate()


def test_a_processor_in_the_loop(tmp_path: Path) -> None:
    """Python runs the plant, the board the controller: the run is the one with Python's controller, within 1e-9."""
    spec = "sine:frequency=2 Hz,amplitude=0.3 mm,duration=0.5 s,loop=closed"
    wanted = reference(parse_excitation(spec), rate=2500.0)
    board = Board(program(servo_design(), tmp_path))
    try:
        run = simulate_closed(servo(), TABLE, wanted, board, generator=np.random.default_rng(3))
    finally:
        board.stop()
    ours = simulate_closed(servo(), TABLE, wanted, Stepper(servo_design()), generator=np.random.default_rng(3))
    assert np.abs(ours.position - wanted.position).max() < 5e-6, "the loop tracks"
    for name in ("command", "position", "current"):
        theirs = getattr(ours, name)
        assert np.abs(getattr(run, name) - theirs).max() <= 1e-9 * np.abs(theirs).max(), name


def test_the_header_stands_alone_and_allocates_nothing(tmp_path: Path) -> None:
    source = ControllerSource(servo_design(), servo_map())
    write(source, tmp_path / "c.h", name="servo_2")
    text = (tmp_path / "c.h").read_text(encoding="ascii")
    assert text == controller_header(source, name="servo_2"), "the same for the same design"
    for word in ("malloc", "calloc", "free(", "static double", '#include "'):
        assert word not in text
    assert {line for line in text.splitlines() if line.startswith("#include")} == {
        "#include <float.h>",
        "#include <math.h> /* the macros NAN and INFINITY; no function of the mathematical library is called */",
    }
    with pytest.raises(InputError, match="cannot begin the names of a C header"):
        controller_header(source, name="2servo")

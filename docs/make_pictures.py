"""The pictures of the documentation, made anew from the code and its data.

    python docs/make_pictures.py [NAME ...]        all of them, or those named (without ending)

Fields and comparisons come from matplotlib; pictures of the report are taken in a headless
Chromium, as the tests do it.
"""

import sys
import tempfile
from collections.abc import Callable
from contextlib import chdir
from dataclasses import replace
from functools import partial
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.pyplot import imsave, subplots

ROOT = Path(__file__).parent.parent
PICTURES = Path(__file__).parent / "pictures"
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "tests"), str(ROOT)]

from devtools import find_browser, started  # noqa: E402
from emps import LOOP, pulses  # noqa: E402
from friction_drive import closed_loop, inverse_dynamics, refined  # noqa: E402
from published_magnets import INCH, ROTERS_CURRENT, SOLENOID_CURRENT, roters, solenoid  # noqa: E402

from msl_fem.actuator import load_actuator  # noqa: E402
from msl_fem.cli.app import app  # noqa: E402
from msl_fem.cli.output import run_guarded  # noqa: E402
from msl_fem.magnetics.field.magnet_field import solve_with_field  # noqa: E402
from msl_fem.magnetics.field.plunger import solve_plunger  # noqa: E402
from msl_fem.magnetics.field_map import decoupling_map  # noqa: E402
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, sweep  # noqa: E402
from msl_fem.plant.operating_point import net_force  # noqa: E402
from msl_fem.plant.plant import plant_parameters  # noqa: E402
from msl_fem.record import load_record  # noqa: E402
from msl_fem.report.field_picture import draw_field  # noqa: E402
from msl_fem.report.figures import BLUE, GREY, ORANGE  # noqa: E402
from msl_fem.report.page import write_page  # noqa: E402
from msl_fem.report.pictures import draw_decoupling  # noqa: E402
from msl_fem.report.study_page import study_page  # noqa: E402
from msl_fem.study import run_study  # noqa: E402
from msl_fem.table.magnetic_table import MagneticTable  # noqa: E402
from msl_fem.table.pair_table import load_table  # noqa: E402

SERVO = ROOT / "geometries" / "fast_tool_servo.toml"
TABLE = ROOT / "lookup_tables" / "fast_tool_servo.nc"
REFERENCE = ROOT / "tests" / "reference"


def save(figure: Figure, name: str) -> None:
    figure.savefig(PICTURES / f"{name}.png", dpi=110)


def field() -> None:
    """The reference actuator's magnet at the current that brings 1.2 T at the nominal gap."""
    point, magnet, solution = solve_with_field(load_actuator(SERVO), 3.39, 0.6e-3)
    title = f"3.39 A, gap 0.6 mm: {point.quantities.force:.1f} N"
    save(draw_field(magnet, solution, title=title), "field")


def e1() -> None:
    """Force and flux errors of E1's 60 points at the default accuracy, against the converged reference."""
    reference = np.genfromtxt(REFERENCE / "reference.csv", delimiter=",", names=True)
    currents, gaps = np.unique(reference["current_A"]), np.unique(reference["gap_mm"]) * 1e-3
    actuator = load_actuator(ROOT / "geometries" / "e1.toml")
    table, _ = sweep(actuator, gaps, np.r_[0.0, currents], settings=SweepSettings("normal"))
    figure, axes = subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharey=True)
    for panel, name, column in ((axes[0], "force", "force_N"), (axes[1], "flux_linkage", "flux_linkage_Wb")):
        ours = [float(table.evaluate(r["current_A"], r["gap_mm"] * 1e-3)[name]) for r in reference]
        error = np.abs(np.array(ours) / reference[column] - 1)
        colours = mpl.colormaps["viridis"](np.linspace(0, 0.9, gaps.size))
        for gap, colour in zip(np.unique(reference["gap_mm"]), colours, strict=True):
            row = reference["gap_mm"] == gap
            panel.semilogy(reference["current_A"][row], error[row], ".-", color=colour, label=f"{gap:g} mm")
        panel.set(xlabel="coil current in A", title=f"{name.replace('_', ' ')}, relative error")
        panel.grid(alpha=0.3)
    axes[0].legend(frameon=False, ncols=2, fontsize=8)
    save(figure, "e1")


def solenoid_force() -> None:
    """The Modelica library's solenoid beside its finite-element reference."""
    x, force = np.genfromtxt(REFERENCE / "solenoid" / "fea_quasistatic_12V.csv", delimiter=",")[:, :2].T
    ours = [solve_plunger(solenoid(), SOLENOID_CURRENT, float(at)).force for at in x]
    _beside(x * 1e3, -force, -np.array(ours), ("air gap in mm", "published computation"), "solenoid")


def roters_force() -> None:
    """Roters' plunger magnet beside his measurement."""
    inches, _, force = np.genfromtxt(REFERENCE / "roters" / "measured_force.csv", delimiter=",").T
    ours = [abs(solve_plunger(roters(), ROTERS_CURRENT, -float(at) * INCH).force) for at in inches]
    _beside(inches * 25.4, force, np.array(ours), ("withdrawal in mm", "measured (Roters 1941)"), "roters")


def _beside(x: np.ndarray, theirs: np.ndarray, ours: np.ndarray, labels: tuple[str, str], name: str) -> None:
    figure, panel = subplots(figsize=(5.4, 3.6), layout="constrained")
    panel.plot(x, theirs, "o", color=GREY, markersize=5, label=labels[1])
    panel.plot(x, ours, "-", color=BLUE, label="msl_fem")
    panel.set(xlabel=labels[0], ylabel="force in N", ylim=(0, None))
    panel.legend(frameon=False)
    panel.grid(alpha=0.3)
    save(figure, name)


def decoupling() -> None:
    """How far the two sides of the reference actuator are independent."""
    save(draw_decoupling(decoupling_map(load_actuator(SERVO))), "decoupling")


def biased_pair() -> None:
    """Force of both sides about 3 A, and what two magnets taken apart get wrong of it, by polarity."""
    pair, bias = load_table(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc"), 3.0
    plant = plant_parameters(load_actuator(SERVO))
    control = np.linspace(-bias, bias, 121)

    def force(table: MagneticTable, polarity: float, x: float) -> np.ndarray:
        turned, at = plant._replace(polarity=polarity), np.array(x)
        held = [net_force(turned, table, currents=(bias + d, bias - d), position=at)[0] for d in control]
        return np.array(held) + plant.stiffness * x

    figure, (whole, wrong) = subplots(1, 2, figsize=(9, 3.6))
    for x, colour in ((0.0, BLUE), (0.1e-3, GREY), (0.2e-3, ORANGE)):
        for polarity, style, name in ((-1.0, "-", "opposing"), (1.0, "--", "aiding")):
            label = f"x = {1e3 * x:.1f} mm, {name}"
            both = force(pair, polarity, x)
            apart = force(replace(pair, shared=None), polarity, x)
            whole.plot(control, both, style, color=colour, label=label)
            wrong.plot(control, apart - both, style, color=colour, label=label)
    whole.set(title="bias 3 A: force of both sides", xlabel="control current d in A", ylabel="N")
    wrong.set(title="two magnets apart: force too large by", xlabel="control current d in A", ylabel="N")
    wrong.legend(frameon=False, fontsize=8)
    for axis in (whole, wrong):
        axis.grid(color="0.9")
    figure.tight_layout()
    save(figure, "biased_pair")


def emps() -> None:
    """The measured drive of the EMPS benchmark: the loop simulated with the model fitted on the other record."""
    fit, test = load_record(ROOT / "measurements" / "emps").runs
    period = fit.sampling_period
    start, _ = inverse_dynamics(fit["position_m"], fit["force_N"], period)
    drive = refined(start, LOOP, fit["reference_m"], fit["position_m"], sampling_period=period)
    added = pulses(test, period)
    position, _ = closed_loop(
        drive, LOOP, test["reference_m"], sampling_period=period, start=test["position_m"][0], added=added
    )
    figure, panels = subplots(2, 1, figsize=(7, 4), sharex=True, layout="constrained", height_ratios=(2, 1))
    panels[0].plot(test.time, test["position_m"] * 1e3, color=GREY, label="measured, held out")
    panels[0].plot(test.time, position * 1e3, "--", color=ORANGE, label="simulated")
    panels[0].set_ylabel("position in mm")
    panels[0].legend(frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1, 1))
    panels[1].plot(test.time, (test["position_m"] - position) * 1e6, color=BLUE, linewidth=0.8)
    panels[1].set(ylabel="difference in µm", xlabel="time in s")
    save(figure, "emps")


def diagnosis() -> None:
    """The report of the tutorial's diagnosis, a delay of 3 %: its first screen, and the motion."""
    hidden = ["bench", str(SERVO), "--table", str(TABLE), "--hide", "time_delay=3%", "--seed", "11", "-o", "rig"]
    for spec in (
        "band-limited-noise:bias=0.6 A,amplitude=50 mA,band=500 Hz,duration=1.2 s,seed=2",
        "swept-sine:bias=0.6 A,amplitude=12 mA,start=5 Hz,stop=300 Hz,duration=1 s",
    ):
        hidden += ["--excitation", spec]
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for words in (hidden, ["diagnose", "rig", "--table", str(TABLE), "-o", "found"]):
            if run_guarded(partial(app, words)) != 0:
                sys.exit(f"msl-fem {' '.join(words)} has failed")
        with started(_browser(), Path("profile")) as browser:
            browser.size(1000)
            browser.open(Path("found") / "report.html")
            assert not browser.complaints, browser.complaints
            browser.run("motion.show(150)")
            whole, motion = (
                imread(browser.picture(Path(f"{n}.png"), of=of))
                for n, of in enumerate(("html", "section:has(#motion)"))
            )
            below = np.ones((motion.shape[0], whole.shape[1], whole.shape[2]), dtype=whole.dtype)
            below[:, 20 : 20 + motion.shape[1]] = motion[:, : whole.shape[1] - 20]
            imsave(PICTURES / "diagnosis.png", np.concatenate([whole[:364], below]))


def _browser() -> str:
    program = find_browser()
    if program is None:
        sys.exit("no Chromium here; install one (Debian: apt-get install chromium)")
    return program


def report() -> None:
    """The study's report in a browser: its top and its explorer, light and dark."""
    with tempfile.TemporaryDirectory() as folder:
        page = write_page(study_page(run_study(load_actuator(SERVO))), Path(folder) / "report.html")
        with started(_browser(), Path(folder) / "profile") as browser:
            for scheme in ("light", "dark"):
                browser.size(1120)
                browser.colours(scheme)
                browser.open(page, fragment="#gap=0.45&current=3.5")
                assert not browser.complaints, browser.complaints
                browser.picture(PICTURES / f"explorer-{scheme}.png", of="#explorer")
            browser.colours("light")
            browser.open(page)
            whole = browser.picture(Path(folder) / "whole.png")
            imsave(PICTURES / "report.png", imread(whole)[:1010])


ALL: dict[str, Callable[[], None]] = {
    "field": field, "e1": e1, "solenoid": solenoid_force, "roters": roters_force, "decoupling": decoupling,
    "biased_pair": biased_pair, "emps": emps, "diagnosis": diagnosis, "report": report,
}  # fmt: skip

if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    for wanted in sys.argv[1:] or ALL:
        ALL[wanted]()
        print(wanted)

"""Laws that the catalogue lacks, offered by expression or left out: found, and refitted beside the truth.

    python benchmarks/user_laws.py [--left-out]

A carriage of the EMPS' mass and damping under a force, simulated here by small steps of constant acceleration, with one
further law of force each; two runs of 16 s at 1 kHz, one held out, the noise of its instruments. Prints a Markdown
table: the truth, what `diagnose` names, the values with their 95 % intervals. Left out, no law is offered: the formula
that is found, and those next to it with the nats by which they are less probable.
"""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from msl_fem.computing.laws import LawExpression, parse_expression
from msl_fem.diagnosis import diagnose
from msl_fem.diagnosis.estimates import Estimate
from msl_fem.plant.effects import declared
from msl_fem.record import Noise, Record, Run, Sampling, load_record

EMPS = Path(__file__).parent.parent / "measurements" / "emps"
MASS, DAMPING, RATE, SAMPLES, STEPS = 95.1, 203.5, 1000.0, 16_000, 5
Law = Callable[[float], float]
CASES: tuple[tuple[str, str, Law], ...] = (
    ("drag: force = -a*v*abs(v); a: 0..1000 N s2/m2", "a = 150", lambda v: 150 * v * abs(v)),
    ("cubic: force = -a*v**3; a: 0..20000 N s3/m3", "a = 900", lambda v: 900 * v**3),
    ("root: force = -a*sign(v)*sqrt(abs(v)/w); a: 0..100 N; w: 0.5 m/s", "a = 12",
     lambda v: float(12 * np.sign(v) * np.sqrt(abs(v) / 0.5))),
    ("knee: force = -a*tanh(v/w); a: 0..100 N; w: 0.02..0.5 m/s", "a = 9, w = 0.1",
     lambda v: float(9 * np.tanh(v / 0.1))),
    ("bump: force = -a*v*exp(-(v/w)**2); a: 0..1000 N s/m; w: 0.02..1 m/s", "a = 80, w = 0.15",
     lambda v: float(80 * v * np.exp(-((v / 0.15) ** 2)))),
    ("one_way: force = -a*max(v, 0); a: 0..500 N s/m", "a = 25", lambda v: 25 * max(v, 0.0)),
)  # fmt: skip


def carriage_run(law: Law, name: str, seed: int) -> Run:
    """A run near a moving reference, held there by a spring and a damper whose force is the record's."""
    rng, time = np.random.default_rng(seed), np.arange(SAMPLES) / RATE
    parts = [0.03 / k * np.sin(2 * np.pi * 0.37 * k * time + rng.uniform(0, 6.28)) for k in (1, 2, 3, 5, 8)]
    wanted = np.sum(parts, axis=0)
    x, v, step = float(wanted[0]), 0.0, 1 / RATE / STEPS
    force, position = np.empty(SAMPLES), np.empty(SAMPLES)
    for t in range(SAMPLES):
        position[t] = x
        force[t] = 4e4 * (wanted[t] - x) - 3e3 * v
        for _ in range(STEPS):
            change = step * (force[t] - DAMPING * v - law(v)) / MASS
            x += step * (v + change / 2)
            v += change
    position += 20e-9 * rng.standard_normal(SAMPLES)
    force += 0.05 * rng.standard_normal(SAMPLES)
    columns = {"time_s": time, "force_N": force, "position_m": position}
    return Run(name, "multisine", "fit" if seed % 2 else "held-out", columns)


def record_of(law: Law, *causes: LawExpression) -> Record:
    """A fitted run and one held out, with a law in them, and causes that are offered."""
    runs = carriage_run(law, "one", 1), carriage_run(law, "two", 2)
    noise = Noise(position=20e-9, force=0.05)
    actuator = load_record(EMPS).actuator
    return Record("simulated", actuator, Sampling(rate=RATE), noise, runs=runs, causes=causes)


def offered() -> None:
    """Each law is offered by its expression."""
    print("| law | truth | verdict | found (95 %) |\n| --- | --- | --- | --- |")
    for text, truth, law in CASES:
        cause = parse_expression(text)
        with declared(cause):
            found = diagnose(record_of(law, cause))
        told = [f"{one.effect}: {', '.join(_values(one.parameters))}" for one in found.causes]
        print(f"| `{text.partition(';')[0]}` | {truth} | {found.verdict} | {'; '.join(told)} |", flush=True)


def left_out() -> None:
    """No law is offered: which formula is found."""
    print("| law | truth | names | formula (95 %) | next ones |\n| --- | --- | --- | --- | --- |")
    for text, truth, law in CASES:
        found = diagnose(record_of(law))
        formula, told = found.formula, "none | "
        if formula is not None:
            rivals = [f"`{rival.law}` {formula.gain - rival.gain:.3g}" for rival in formula.rivals]
            told = f"`{formula.law}`, {', '.join(_values(formula.parameters))} | {', '.join(rivals)}"
        names = ", ".join(found.names) or "none"
        print(f"| `{text.partition(';')[0]}` | {truth} | {names} | {told} |", flush=True)


def _values(parameters: Mapping[str, Estimate]) -> list[str]:
    return [f"{name} {one.value:.4g} ({one.low:.4g} ... {one.high:.4g})" for name, one in parameters.items()]


def main() -> None:
    """Simulates, diagnoses, prints."""
    left_out() if "--left-out" in sys.argv[1:] else offered()


if __name__ == "__main__":
    main()

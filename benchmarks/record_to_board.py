"""From a record to C in one command, and whether the loop with it is as much better as its page foretold.

    python benchmarks/record_to_board.py [--kept record_to_board.json] [--work DIR] [--docs]

Each case is a rig of the virtual bench with true parameters of its own and causes hidden in it. Its record is given to
`msl-fem control --from RECORD --c controller.h --report page.html`; the controller of the belief is exported beside.
Both headers are compiled, and the programs close the loop around the bench's own rig, of which neither the diagnosis
nor the design knows anything but the record. Foretold is the factor of the command's JSON, on plants that the
diagnosis leaves possible. Each case is kept as soon as it is done, and the same command
again goes on, in the middle of a case too. With --docs the table of docs/howto/my_board.md is
written anew.
"""

import argparse
import ctypes
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from controller_cases import ROOT, SERVO, TABLE, Array
from marked_text import rewrite

from msl_fem.bench import BenchOptions, parse_requests, sealed_record
from msl_fem.bench.instruments import instrument_noise, noise_of_instruments
from msl_fem.bench.rig import Rig
from msl_fem.bench.running import Following, follow
from msl_fem.bench.sealed import _hidden, prepared_setting, with_all
from msl_fem.control.preview import known_ahead
from msl_fem.errors import ComputationError
from msl_fem.files.whole_file import whole_file
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.record import write_record

DOCUMENT = ROOT / "docs" / "howto" / "my_board.md"
ACTUATOR, TABLE_FILE = ROOT / "geometries" / "fast_tool_servo.toml", ROOT / "lookup_tables" / "fast_tool_servo.nc"
RATE, LOOP_RATE, UNSEEN = 1e4, 2500.0, 40
RUNS = (
    "band-limited-noise:bias=0.6 A,amplitude=47 mA,band=500 Hz,duration=1.2 s,seed=1,role=fit",
    "swept-sine:bias=0.6 A,amplitude=12 mA,start=5 Hz,stop=300 Hz,duration=1 s,role=held-out",
)
FOLLOWED = "sine:frequency=2 Hz,amplitude=0.4 mm,duration=1 s"
Case = tuple[int, tuple[str, ...]]  # seed, what is hidden
CASES: tuple[Case, ...] = (
    (1301, ("gap_offset",)),
    (1302, ("stiffness_nonlinearity",)),
    (1303, ("gap_offset", "stiffness_nonlinearity")),
    (1304, ("support_compliance",)),
    (1305, ("gap_offset", "eddy_currents", "position_sensor_lag")),
    (1306, ()),
)
HEAD = (
    "| hidden | rig | foretold (95 % of the plants) | on the rig | rig over foretold | error of the belief's loop "
    "| of the told one |\n| --- | --- | --- | --- | --- | --- | --- |\n"
)


class BoardLoop:
    """An exported controller, compiled, as the bench's controller."""

    def __init__(self, header: Path, name: str = "fast_tool_servo") -> None:
        source, library = header.with_suffix(".c"), header.with_suffix(".so")
        source.write_text(
            f'#include "{header.name}"\nstatic {name}_controller c;\n'
            f"int check(void) {{ return {name}_controller_self_check(); }}\n"
            f"void start(void) {{ {name}_controller_start(&c); }}\n"
            f"double lead(void) {{ return {name}_controller_lead(); }}\n"
            f"void step(const double *r, double y, double *out) {{ {name}_controller_step_ahead(&c, r, y, out); }}\n"
        )
        subprocess.run(["gcc", "-std=c99", "-O2", "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
        self._c = ctypes.CDLL(str(library))
        self._c.lead.restype = ctypes.c_double
        self._c.step.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
        assert self._c.check() == 0, f"{header}: this compiler gives other bits"
        self._command = np.zeros(2)

    rate, delay_samples, current_loop_rate = LOOP_RATE, 1, None

    def start(self) -> None:
        self._c.start()

    def rows(self, samples: Array, *, period: float) -> Array:
        return np.ascontiguousarray(np.hstack([samples, known_ahead(samples, period=period, lead=self._c.lead())]))

    def command(self, reference_: Array, measured: float) -> Array:
        self._c.step(np.ascontiguousarray(reference_).ctypes.data, measured, self._command.ctypes.data)
        return self._command.copy()

    def voltage(self, wanted: Array, read: Array, measured: float) -> Array:
        raise NotImplementedError("the board's controller drives currents")


@dataclass(frozen=True, eq=False)
class OnTheBench:
    """The true rig of a case, and its record in a folder."""

    rig: Rig
    record: Path
    seed: int


def recorded(case: Case, folder: Path) -> OnTheBench:
    """A case's rig, and its record as `msl-fem bench` writes it."""
    seed, hidden = case
    options = BenchOptions(seed=seed, rate=RATE, excitations=tuple(parse_excitation(spec, unit="A") for spec in RUNS))
    requests = parse_requests(list(hidden))
    setting = prepared_setting(SERVO, TABLE, options.excitations, options)
    chosen: list[Any] = []
    for request in requests:
        chosen.append(_hidden(setting, request, chosen, exact=False))
    if not (folder / "record").exists():
        write_record(sealed_record(SERVO, TABLE, requests, options).record, folder / "record")
    return OnTheBench(with_all(setting, chosen), folder / "record", seed)


def tracked(bench: OnTheBench, header: Path) -> float:
    """Settled RMS of reading less reference over the amplitude, the exported controller around the true rig."""
    board = BoardLoop(header)
    path = reference(parse_excitation(FOLLOWED, unit="m"), rate=RATE)
    samples = np.column_stack([path.position, path.velocity, path.acceleration])
    how = noise_of_instruments(SERVO, coloured=True)
    noise = instrument_noise(len(samples), how, rate=RATE, generator=np.random.default_rng([bench.seed, 77]))
    asked = Following(board.rows(samples, period=1 / RATE), board, how.sigma["position"] * noise)
    response = follow(bench.rig, asked, rate=RATE, seed=9)
    assert response.measured is not None
    missed = (response.measured - path.position)[:: round(RATE / LOOP_RATE)]
    return float(np.sqrt(np.mean(missed[missed.size // 2 :] ** 2)) / np.abs(path.position).max())


def ran(*words: str) -> str:
    """What a command of the package prints."""
    done = subprocess.run([sys.executable, "-m", "msl_fem.cli", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise ComputationError(f"{' '.join(words)}: {done.stderr[-2000:]}")
    return done.stdout


def judged(case: Case, folder: Path) -> dict[str, Any]:
    """Foretold and measured factor of a case."""
    bench = recorded(case, folder)
    told, before, said = folder / "told.h", folder / "belief.h", folder / "answer.json"
    if not said.exists():
        text = ran(
            "control", "--from", str(bench.record), "--table", str(TABLE_FILE), "--reference", FOLLOWED,
            "--unseen", str(UNSEEN), "--c", str(told), "--report", str(folder / "page.html"), "--json",
        )  # fmt: skip
        said.write_text(text)
    answer = json.loads(said.read_text())
    ran(
        "export", str(ACTUATOR), "--table", str(TABLE_FILE), "--to", "c", "--what", "controller", "--belief", "plain",
        "-o", str(before),
    )  # fmt: skip
    errors = {name: tracked(bench, header) for name, header in (("belief", before), ("told", told))}
    foretold = answer["loop"]["over_belief"]
    diagnosis = json.loads((folder / "record.diagnosis" / "diagnosis.json").read_text())
    return {
        "foretold": foretold["factor"],
        "interval": foretold["factor_interval"],
        "named": [cause["effect"] for cause in diagnosis["causes"]],
        "held_share": answer["loop"]["held_share"],
        "error_foretold": answer["loop"]["unseen"]["error_median"],
        "belief_error_foretold": foretold["belief_error_median"],
        "errors": errors,
        "measured": errors["belief"] / errors["told"],
    }


def row(case: Case, of: dict[str, Any]) -> str:
    low, high = of["interval"]
    return (
        f"| {', '.join(f'`{name}`' for name in case[1]) or 'nothing'} | {case[0]} | {of['foretold']:.2f} "
        f"({low:.2f} ... {high:.2f}) | {of['measured']:.2f} | {of['measured'] / of['foretold']:.2f} "
        f"| {100 * of['errors']['belief']:.3f} % | {100 * of['errors']['told']:.3f} % |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kept", type=Path, default=Path("record_to_board.json"))
    parser.add_argument("--work", type=Path, default=Path("record_to_board"), help="records and what became of them")
    parser.add_argument("--most", type=int, default=len(CASES), help="cases that are judged now")
    parser.add_argument("--docs", action="store_true")
    asked = parser.parse_args()
    kept = json.loads(asked.kept.read_text()) if asked.kept.exists() else {}
    left = asked.most
    for case in CASES:
        key = json.dumps(case)
        if key not in kept and left > 0:
            left -= 1
            folder = asked.work / str(case[0])
            folder.mkdir(parents=True, exist_ok=True)
            kept[key] = judged(case, folder)
            with whole_file(asked.kept) as part:
                part.write_text(json.dumps(kept))
        if key in kept:
            print(row(case, kept[key]), flush=True)
    if asked.docs:
        rows = [row(case, kept[json.dumps(case)]) for case in CASES]
        rewrite(DOCUMENT, {"foretold": HEAD + "\n".join(rows)})


if __name__ == "__main__":
    main()

"""What commands wrote and read again, spoilt: found by the fuzzer, one line for each."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from later_targets import FOUND, _found

from msl_fem.cli.experiments import question_after
from msl_fem.cli.told import DIAGNOSIS, MARK, mark_of, told_by
from msl_fem.control import PlantUnderTest
from msl_fem.errors import InputError

STATED: dict[str, Any] = json.loads((FOUND / DIAGNOSIS).read_text())
Change = Callable[[dict[str, Any]], object]


def spoilt(folder: Path, change: Change) -> Path:
    """A folder of a diagnosis, its content changed."""
    file, content = _found(DIAGNOSIS)(folder), json.loads(json.dumps(STATED))
    change(content)
    file.write_text(json.dumps(content))
    return folder


def of(name: str, **entries: object) -> Change:
    return lambda content: content["parameters"][name].update(entries)


def correlated(matrix: object) -> Change:
    return lambda content: content["correlation"].update(matrix=matrix)


NAMES = STATED["correlation"]["names"]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c["causes"][0].update(effect=["time_delay"]), "causes.0.effect"),
        (lambda c: c["causes"][0]["parameters"]["command"].update(ci95=[1e-5]), "causes.0.parameters.command.ci95"),
        (of("moving_mass", fitted="0.9"), "parameters.moving_mass.fitted"),
        (of("moving_mass", ci95=[-5.0, 5.0]), "it must be below a third"),
        (of("moving_mass", fitted=1e-320, ci95=[-5.0, 5.0]), "it must be below a third"),
        (of("stiffness", fitted=1e-320), "out of proportion"),
        (of("moving_mass", ci95=[0.0, 1e300]), "parameters.moving_mass.ci95"),
        (of("moving_mass", ci95=[float("nan"), 1.0]), "parameters.moving_mass.ci95"),
        (correlated([[1.0]]), f"{len(NAMES)} rows"),
        (correlated((5 * np.eye(len(NAMES))).tolist()), "is no correlation"),
        (correlated((np.eye(len(NAMES)) + np.eye(len(NAMES), k=1)).tolist()), "is no correlation"),
        (correlated((1 - 4 * (1 - np.eye(len(NAMES)))).tolist()), "is no correlation"),
        (of("coil_resistance", fitted=0.0), "parameters.coil_resistance.fitted: 0"),
        (of("coil_resistance", fitted=-2.0), "parameters.coil_resistance.fitted: -2"),
        (of("coil_resistance", believed=-2.0), "coil_resistance"),
        (of("moving_mass", believed=-0.9), "moving_mass"),
        (of("nominal_gap", believed=0.0), "nominal_gap"),
        (of("stiffness", believed="1"), "parameters.stiffness.believed"),
        (lambda c: c["belief"]["values"][0].update(effect=[]), "belief.values.0.effect"),
        (lambda c: c["belief"]["values"][0].update(value=1e300), "belief.values.0.value"),
        (lambda c: c["belief"]["values"][0].update(parameter="size"), "size"),
    ],
)
def test_a_diagnosis_of_no_plant_is_refused(tmp_path: Path, change: Change, told: str) -> None:
    with pytest.raises(InputError, match=rf"--from .*{DIAGNOSIS}: .*{told}"):
        told_by(spoilt(tmp_path, change))


def test_a_damping_that_is_hardly_known_is_drawn_from_zero_on(tmp_path: Path) -> None:
    told = told_by(spoilt(tmp_path, of("damping", fitted=7.5, ci95=[-15.0, 30.0])))
    plant, generator = PlantUnderTest(told.model.actuator, None, told.model.effects), np.random.default_rng(1)
    drawn = [told.posterior.draw(plant, generator).actuator.motion for _ in range(60)]
    assert {motion is not None and motion.damping >= 0 for motion in drawn} == {True}
    assert min(motion.damping for motion in drawn if motion is not None) == 0.0


def test_a_usual_run_beyond_measure_is_refused(tmp_path: Path) -> None:
    longer = STATED["usual_run"]["excitation"].replace("duration=400 ms", "duration=1000 s")
    with pytest.raises(InputError, match="usual_run: 5000000 samples"):
        question_after(spoilt(tmp_path, lambda c: c["usual_run"].update(excitation=longer)), None, None)


@pytest.mark.parametrize("content", [b"\xff\xfe", b"\x00" * 40, b"a" * 17_000_000])
def test_a_mark_that_cannot_be_read_is_of_no_record(tmp_path: Path, content: bytes) -> None:
    (tmp_path / MARK).write_bytes(content)
    assert mark_of(tmp_path) != "0123456789abcdef"
    assert mark_of(tmp_path / "none") == ""

"""The extended model's file: read, written, refused."""

from pathlib import Path

import pytest

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model, write_extended_model

ROOT = Path(__file__).parents[2]
PLAIN = (ROOT / "geometries" / "fast_tool_servo.toml").read_text()


def test_effects_are_read_with_their_units(tmp_path: Path) -> None:
    file = tmp_path / "extended_model.toml"
    stated = '[effects.eddy_currents]\ntime_constant = "0.12 ms"\n[effects.fringing]\ndepth_error = 0.01\n'
    file.write_text(f"{PLAIN}\n{stated}")
    model = load_extended_model(file)
    assert model.actuator.name == "fast_tool_servo"
    assert model.effects.get("eddy_currents", "time_constant") == pytest.approx(1.2e-4, rel=1e-15)
    assert model.effects.get("fringing", "depth_error") == 0.01
    assert model.effects.present == ("eddy_currents", "fringing")


def test_a_plain_actuator_is_an_extended_model_without_effects(servo: Actuator) -> None:
    model = load_extended_model(ROOT / "geometries" / "fast_tool_servo.toml")
    assert model == ExtendedModel(servo)
    assert model.effects.stated == {}


def test_what_is_written_reads_back(servo: Actuator, tmp_path: Path) -> None:
    effects = EffectValues(
        {
            "time_delay": {"command": 1.37e-4},
            "stiffness_nonlinearity": {"cubic": -3.7e9},
            "cross_coupling": {"share": 0.0123},
            "armature_tilt": {"gap_variance": 4.1e-10},
        }
    )
    made = write_extended_model(ExtendedModel(servo, effects), tmp_path / "deep" / "extended_model.toml")
    back = load_extended_model(made)
    assert back.effects == effects
    assert back.actuator.model_copy(update={"file": None}) == servo.model_copy(update={"file": None})
    with pytest.raises(ActuatorError, match=r"effects"):
        load_actuator(made)


def test_names_of_files_stay_right(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "table.nc").write_bytes(b"")
    start = PLAIN[: PLAIN.index("[magnet]")] + '[magnet]\nkind = "table"\ntable = "table.nc"\n'
    (tmp_path / "here" / "a.toml").write_text(start + PLAIN[PLAIN.index("[sides]") : PLAIN.index("[sources]")])
    model = load_extended_model(tmp_path / "here" / "a.toml")
    made = write_extended_model(model, tmp_path / "there" / "b.toml")
    again = load_extended_model(made).actuator
    assert (again.folder / again.magnet.table).resolve() == tmp_path / "here" / "table.nc"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[effects.eddy]\n", "effects: 'eddy' is no effect of the catalogue"),
        ("[effects.eddy_currents]\ntau = 1\n", "effects.eddy_currents: 'tau' is no parameter"),
        ("[effects.eddy_currents]\ntime_constant = 1e-4\n", 'has no unit; write a text like "100 µs"'),
        ('[effects.eddy_currents]\ntime_constant = "1 mm"\n', "wrong dimension"),
        ('[effects.eddy_currents]\ntime_constant = "1 s"\n', "effects.eddy_currents.time_constant: 1 s is not allowed"),
        ("[effects.cross_coupling]\nshare = true\n", "True is no quantity"),
        ("[effects]\ncross_coupling = 3\n", "effects.cross_coupling is no table"),
    ],
)
def test_a_file_that_is_none_is_refused_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    file = tmp_path / "extended_model.toml"
    file.write_text(PLAIN + "\n" + text)
    with pytest.raises(ActuatorError, match=complaint) as caught:
        load_extended_model(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_effects_that_are_no_table_and_files_that_are_not_there(tmp_path: Path) -> None:
    file = tmp_path / "extended_model.toml"
    file.write_text("effects = 3\n" + PLAIN)
    with pytest.raises(ActuatorError, match=r"effects is no table"):
        load_extended_model(file)
    with pytest.raises(ActuatorError, match="cannot be read"):
        load_extended_model(tmp_path / "none.toml")
    with pytest.raises(InputError):
        write_extended_model(ExtendedModel(load_actuator(ROOT / "geometries" / "e1.toml")), tmp_path)


def test_an_example_is_read_by_its_name_here_too() -> None:
    """`control` and `simulate` take extended models; their help offers the example by its name, as everywhere."""
    model = load_extended_model("fast_tool_servo")
    assert model.actuator == load_actuator("fast_tool_servo")
    assert not model.effects.stated

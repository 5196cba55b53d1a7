"""`export --what controller` takes the options of `control` and writes that design."""

from pathlib import Path

import pytest
from cli_paths import SERVO, TABLE

from msl_fem.actuator import load_actuator
from msl_fem.control import ControllerChoice, design_model_of, designed
from msl_fem.export.c_controller import ControllerSource, controller_header
from msl_fem.maps import operating_map
from msl_fem.table.magnetic_table import read_table

CONTROLLER = ("--table", TABLE, "--belief", "plain", "--to", "c", "--what", "controller")


@pytest.mark.parametrize(
    ("options", "choice"),
    [
        (("--design", "pid", "--overlap", "1 N"), ControllerChoice("pid", overlap=1.0)),
        (("--design", "biased", "--bias", "0.9 A"), ControllerChoice("biased", bias=0.9)),
    ],
)
def test_the_design_of_the_options_is_written(msl_fem, options, choice, tmp_path: Path) -> None:
    table = read_table(TABLE)
    regions = operating_map(table)
    wanted = designed(design_model_of(load_actuator(SERVO), table, regions), choice)
    file = tmp_path / "c.h"
    assert msl_fem("export", SERVO, *CONTROLLER, *options, "-o", str(file), "--json").json["files"] == [str(file)]
    assert file.read_text() == controller_header(ControllerSource(wanted, regions))


def test_options_of_a_design_belong_to_a_controller(msl_fem, tmp_path: Path) -> None:
    target = ("-o", str(tmp_path / "t.h"))
    said = msl_fem("export", TABLE, "--to", "c", "--design", "pid", *target).complaint
    assert "--design is of a controller's design; add --what controller" in said
    said = msl_fem("export", TABLE, "--to", "c", "--no-preview", *target).complaint
    assert "--no-preview is of a controller's design" in said
    said = msl_fem("export", SERVO, *CONTROLLER, "--bandwidth", "5 N", *target).complaint
    assert "--bandwidth" in said
    assert not (tmp_path / "t.h").exists()

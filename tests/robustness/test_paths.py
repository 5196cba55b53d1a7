"""Paths in files and names of files: what they may lead to, and where nothing is written."""

import shutil
from pathlib import Path

import pytest
from targets import LOG, RIG, SERVO, TABLE, TYPED_COLUMNS, _record

from msl_fem.errors import InputError, RecordError
from msl_fem.materials.material import load_iron
from msl_fem.record import load_record

LEADING_AWAY = ["../run.csv", "../../../../etc/passwd", "/etc/passwd", "a/../../run.csv", "C:\\run.csv", "..\\run.csv",
                "run.csv\\u0000.csv", "~/run.csv", "", "/dev/zero", "."]  # fmt: skip


@pytest.mark.parametrize("name", LEADING_AWAY)
def test_a_run_outside_the_record_is_refused(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "rec"
    folder.mkdir()
    rig = _record("rig.toml")(folder)
    (tmp_path / "run.csv").write_bytes((folder / "run.csv").read_bytes())
    rig.write_text(
        RIG.replace('file = "run.csv"', "file = '" + name + "'" if "\\u" not in name else f'file = "{name}"')
    )
    with pytest.raises(RecordError):
        load_record(folder)


def test_a_link_out_of_the_record_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "rec"
    folder.mkdir()
    _record("rig.toml")(folder)
    (folder / "run.csv").rename(tmp_path / "outside.csv")
    (folder / "run.csv").symlink_to(tmp_path / "outside.csv")
    with pytest.raises(RecordError, match="lies outside the record's folder"):
        load_record(folder)


@pytest.mark.parametrize("target", ["/dev/zero", "/dev/full", "/proc/self/mem", "/", "/dev/null"])
def test_a_device_in_place_of_a_file_ends_soon(target: str, tmp_path: Path, msl_fem) -> None:
    """None of these is read for ever, whoever names it: the command line, or a file that came from elsewhere."""
    link = tmp_path / "a.toml"
    link.symlink_to(target)
    assert msl_fem("flexure", str(link)).complaint
    assert msl_fem("flexure", target).complaint
    assert msl_fem("guard", target, "--current", "1 A", "--gap", "1 mm").complaint
    assert msl_fem("lookup", target, "--current", "1 A", "--gap", "1 mm").complaint
    assert msl_fem("identify", target).complaint
    with pytest.raises(InputError):
        load_iron(f"{target}.csv" if target == "/" else str(_named(tmp_path / "iron.csv", target)))
    folder = tmp_path / "rec"
    folder.mkdir()
    _record("rig.toml")(folder).write_text(RIG.replace("actuator.toml", target))
    with pytest.raises(InputError):
        load_record(folder)


def _named(link: Path, target: str) -> Path:
    link.symlink_to(target)
    return link


@pytest.mark.parametrize("name", ["../x", "/tmp/x", "a/b", ".x", " ", "x\ny", "-rf", "é", "a" * 300])
def test_a_runs_name_stays_a_name(name: str, tmp_path: Path, msl_fem) -> None:
    """A name that would be a path, or hidden, is refused or made a plain file in the chosen folder."""
    log = tmp_path / "log.csv"
    log.write_text(LOG)
    options = ("--columns", TYPED_COLUMNS, "--actuator", str(SERVO), "-o", str(tmp_path / "rec"), f"--name={name}")
    done = msl_fem("import", str(log), *options)
    assert done.status in (0, 2), done.stderr
    assert "Traceback" not in done.stderr
    top = {path.name for path in tmp_path.iterdir()}
    assert top <= {"log.csv", "rec", "rec_log.png", *([f"rec_{name}.png"] if done.status == 0 else [])}
    assert not list(tmp_path.parent.glob("x*"))


def test_odd_names_of_files_are_names(tmp_path: Path, msl_fem) -> None:
    """Blanks, quotes, markup, a newline, a leading dash: read and written as they are, and said on one line."""
    for name in (
        "a b.nc",
        "a'b\".nc",
        "<b>x<b>.nc",
        "$(touch canary).nc",
        "a\nb.nc",
        "[red]x[red].nc",
        "%s.nc",
        "ü.nc",
    ):
        source, target = tmp_path / name, tmp_path / f"{name}.csv"
        shutil.copyfile(TABLE, source)
        msl_fem("export", str(source), "--to", "csv", "-o", str(target), "--json").json  # noqa: B018 - asserts inside
        assert target.is_file()
        source.write_bytes(b"no table")
        assert msl_fem("export", str(source), "--to", "csv", "-o", str(target)).complaint
    assert not list(tmp_path.rglob("canary"))

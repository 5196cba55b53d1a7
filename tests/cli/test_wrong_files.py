"""Wrong files: a result never replaces what it is made from; another magnet's table and a missing section are named."""

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_paths import E1, SERVO, TABLE

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
POINT = ("--current", "1 A", "--gap", "0.5 mm")
GRID = ("--gaps", "0.3,0.5 mm", "--currents", "1,2,5 A")


@pytest.mark.parametrize(
    ("source", "command"),
    [
        (TABLE, ("map", "mine", "-o", "mine")),
        (E1, ("map", "mine.toml", "-o", "mine.toml")),
        (E1, ("table", "mine.toml", "-o", "mine.toml", *GRID)),
        (E1, ("solve", "mine.toml", *POINT, "--picture", "mine.toml")),
        (SERVO, ("tolerances", "mine.toml", "-o", "mine.toml")),
        (TABLE, ("gap-trade", SERVO, "--table", "mine", "-o", "mine")),
        (TABLE, ("export", SERVO, "--table", "mine", "--to", "c", "--what", "controller", "-o", "mine")),
    ],
)
def test_the_source_is_not_replaced(
    msl_fem: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, command: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    (file,) = {tmp_path / word for word in command if word.startswith("mine")}
    content = Path(source).read_bytes()
    file.write_bytes(content)
    said = msl_fem(*command).complaint
    assert f"{file.name}: is what the command reads" in said
    assert file.read_bytes() == content
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_a_controller_s_missing_section_is_named_alone(msl_fem: Run, tmp_path: Path) -> None:
    """E1 has its magnet, so only [controller] is asked for."""
    reference = ("--reference", "sine:frequency=2 Hz,amplitude=0.1 mm,duration=1 s")
    assert "e1 has no [controller]; control needs" in msl_fem("control", E1, "--table", TABLE, *reference).complaint
    made = str(tmp_path / "c.h")
    said = msl_fem("export", E1, "--table", TABLE, "--to", "c", "--what", "controller", "-o", made).complaint
    assert "e1 has no [controller]; a controller needs" in said
    cart = tmp_path / "cart.toml"
    cart.write_text('schema = 1\nname = "cart"\n', encoding="utf-8")
    assert "cart has no [magnet], [controller];" in msl_fem("control", str(cart), *reference).complaint


def test_a_table_of_another_magnet_is_named(msl_fem: Run, tmp_path: Path) -> None:
    """With its own magnet there is nothing to say."""
    other = tmp_path / "other.toml"
    other.write_text(
        Path(SERVO).read_text(encoding="utf-8").replace('"fast_tool_servo"', '"other"', 1), encoding="utf-8"
    )
    assert "was made for" not in msl_fem("gap-trade", SERVO, "--table", TABLE).stderr
    mixed = msl_fem("gap-trade", str(other), "--table", TABLE)
    assert mixed.status == 0
    assert "was made for 'fast_tool_servo', and is taken here for 'other'" in mixed.stderr

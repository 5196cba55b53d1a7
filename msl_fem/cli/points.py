"""The commands `lookup` and `guard`: a table's values at a point, and an operating map's judgement of it."""

import re
from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.cli.options import Current, Json, read_option
from msl_fem.cli.output import print_columns, print_result
from msl_fem.errors import InputError


def lookup(
    table: Annotated[Path, typer.Argument(metavar="TABLE", help="Table (NetCDF).")],
    current: Current,
    gap: Annotated[str | None, typer.Option("--gap", help='Air gap, like "0.5 mm"; of one magnet.')] = None,
    current_2: Annotated[
        str | None, typer.Option("--current-2", help="Coil current of side 2, equal signs aid; of a pair.")
    ] = None,
    position: Annotated[
        str | None, typer.Option(help='Position of the armature, towards side 1, like "0.1 mm"; of a pair.')
    ] = None,
    json: Json = False,
) -> None:
    """Force, flux linkage and inductance from a table; outside it is an error.

    A table of one magnet takes --gap, one of both sides (`table --sides both`) --current-2 and --position.
    """
    from msl_fem.table.magnetic_table import read_table  # not for a guard, which reads no NetCDF

    amperes = read_option("--current", current, "A")
    if current_2 is not None or position is not None:
        if gap is not None or current_2 is None or position is None:
            raise InputError("both sides need --current, --current-2 and --position, one magnet --current and --gap")
        _look_up_pair(table, amperes, current_2=current_2, position=position, json=json)
        return
    if gap is None:
        raise InputError(
            '--gap is missing, like --gap "0.5 mm"; a table of both sides takes --current-2 and --position'
        )
    values = read_table(table).evaluate(amperes, read_option("--gap", gap, "m"))
    fields = {
        "force_N": float(values["force"]),
        "flux_linkage_Wb": float(values["flux_linkage"]),
        "incremental_inductance_H": float(values["incremental_inductance"]),
        "coenergy_J": float(values["coenergy"]),
        "force_current_slope_N_per_A": float(values["force_current_slope"]),
        "force_gap_slope_N_per_m": float(values["force_gap_slope"]),
    }
    print_result(fields, as_json=json, title=f"{table} at {current}, gap {gap}")


def _look_up_pair(table: Path, current: float, *, current_2: str, position: str, json: bool) -> None:
    from msl_fem.table.pair_table import PAIR_NODES, read_pair_table

    where = read_option("--position", position, "m"), current, read_option("--current-2", current_2, "A")
    values = read_pair_table(table).evaluate(*where)
    names = {"force": "net_force"}
    fields = {
        f"{names.get(name, name)}_{unit.replace('/', '_per_')}": float(values[name])
        for name, (unit, _) in PAIR_NODES.items()
    }
    print_result(fields, as_json=json, title=f"{table} at {current:g} A, {current_2}, position {position}")


_NO_NUMBER = re.compile(r"\s*([+-]?)(nan|inf|infinity)\b\s*(.*)", re.IGNORECASE)


def guard(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="Operating map (JSON).")],
    current: Annotated[
        list[str], typer.Option("--current", help='Commanded current, like "4 A"; nan and inf are judged too.')
    ],
    gap: Annotated[
        list[str] | None,
        typer.Option("--gap", help='Air gap, like "0.3 mm"; nan and inf are judged too; of one magnet.'),
    ] = None,
    current_2: Annotated[
        str | None, typer.Option("--current-2", help="Coil current of side 2, equal signs aid; of a pair.")
    ] = None,
    position: Annotated[
        str | None, typer.Option(help='Position of the armature, towards side 1, like "0.1 mm"; of a pair.')
    ] = None,
    json: Json = False,
) -> None:
    """Judge a command: preferred, discouraged or unacceptable, with the limits at that gap.

    Several commands at once: give --current and --gap as often, or one of them once for all of the other. The map of
    both sides takes --current, --current-2 and --position; without --current-2 one side is on.
    """
    if position is not None or current_2 is not None:
        if gap or position is None or len(current) != 1:
            raise InputError(
                "both sides need one --current, --current-2 and --position, one magnet --current and --gap"
            )
        _judge_pair(map_file, current[0], current_2, position=position, json=json)
        return
    if not gap:
        raise InputError('--gap is missing, like --gap "0.3 mm"; a map of both sides takes --current-2 and --position')
    from msl_fem.cli.given_map import given_map  # not for a look-up
    from msl_fem.maps import Guard

    judge = Guard(given_map(map_file)).judge
    pairs = _pairs([_number("--current", c, "A") for c in current], [_number("--gap", g, "m") for g in gap])
    judged = [judge(i, g).to_json() for i, g in pairs]
    if len(judged) == 1:
        print_result(judged[0], as_json=json, title=f"{current[0]} at gap {gap[0]}")
        return
    if json:
        each = [{"current_A": i, "gap_m": g, **found} for (i, g), found in zip(pairs, judged, strict=True)]
        print_result({"judgements": each, "counts": _counts(judged)}, as_json=True, title="")
        return
    columns = {
        "current in A": [f"{i:.6g}" for i, _ in pairs],
        "gap in mm": [f"{g * 1e3:.6g}" for _, g in pairs],
        "region": [found["region"] for found in judged],
        "margin in A": ["-" if found["margin_A"] is None else f"{found['margin_A']:.4g}" for found in judged],
        "reason": [found["reason"] for found in judged],
    }
    print_columns(columns, title=", ".join(f"{n} {name}" for name, n in _counts(judged).items()))


def _judge_pair(map_file: Path, current: str, current_2: str | None, *, position: str, json: bool) -> None:
    from msl_fem.maps.pair_guard import PairGuard
    from msl_fem.maps.pair_map_file import read_pair_map

    other = 0.0 if current_2 is None else _number("--current-2", current_2, "A")
    judge = PairGuard(read_pair_map(map_file)).judge
    judged = judge(_number("--current", current, "A"), other, _number("--position", position, "m")).to_json()
    print_result(judged, as_json=json, title=f"{current} and {current_2 or '0 A'} at position {position}")


def _counts(judged: list[dict[str, Any]]) -> dict[str, int]:
    from msl_fem.maps import REGIONS

    return {name: sum(found["region"] == name for found in judged) for name in REGIONS}


def _pairs(current: list[float], gap: list[float]) -> list[tuple[float, float]]:
    """Both lists element by element, a single value serving all."""
    n = max(len(current), len(gap))
    if len(current) not in (1, n) or len(gap) not in (1, n):
        raise InputError(f"{len(current)} of --current and {len(gap)} of --gap make no pairs; give as many, or one")
    return list(zip(current * (n // len(current)), gap * (n // len(gap)), strict=True))


def _number(name: str, text: str, unit: str) -> float:
    """A quantity, or nan or inf where the text says so: a controller's command can be one."""
    match = _NO_NUMBER.fullmatch(text)
    if match is None:
        return read_option(name, text, unit)
    read_option(name, f"1 {match[3] or unit}", unit)  # a wrong unit is wrong here too
    return float(match[1] + match[2])

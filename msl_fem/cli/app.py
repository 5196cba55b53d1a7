"""The commands by name; a command's module is imported when it runs, so that a look-up need not load a mesher."""

import ast
import re
import sys
from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from msl_fem.cli.help_texts import GROUPS, epilogue
from msl_fem.errors import InputError

COMMANDS = {
    "study": "msl_fem.cli.study:command",
    "draw": "msl_fem.cli.draw:command",
    "solve": "msl_fem.cli.solve:command",
    "table": "msl_fem.cli.table:command",
    "lookup": "msl_fem.cli.points:lookup",
    "map": "msl_fem.cli.map:command",
    "guard": "msl_fem.cli.points:guard",
    "losses": "msl_fem.cli.losses:command",
    "size": "msl_fem.cli.size:command",
    "simulate": "msl_fem.cli.simulate:command",
    "bench": "msl_fem.cli.bench:command",
    "import": "msl_fem.cli.import_log:command",
    "check": "msl_fem.cli.check:command",
    "identify": "msl_fem.cli.identify:command",
    "control": "msl_fem.cli.control:command",
    "loop": "msl_fem.cli.loop:command",
    "self-sensing": "msl_fem.cli.self_sensing:command",
    "compare": "msl_fem.cli.compare:command",
    "diagnose": "msl_fem.cli.diagnose:command",
    "calibrate": "msl_fem.cli.calibrate:command",
    "suspects": "msl_fem.cli.suspects:command",
    "experiments": "msl_fem.cli.experiments:command",
    "export": "msl_fem.cli.export:command",
    "flexure": "msl_fem.cli.mechanics:flexure",
    "gap-trade": "msl_fem.cli.mechanics:trade_gap",
    "tolerances": "msl_fem.cli.tolerances:command",
    "doctor": "msl_fem.cli.doctor:command",
}
"""Command to the module and the function in it."""
LIGHT = {"typing", "pathlib", "typer", "msl_fem.cli.options"}
SETTINGS = {"help_option_names": ["-h", "--help"]}


class LazyCommands(TyperGroup):
    """The group of all commands; a command's module is imported when it runs.

    What a command's options are, and its first sentence, is read from its source: who asks for help, or mistypes an
    option, does not wait for a mesher.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS:
            return None
        single = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, add_completion=False)
        single.command(cmd_name, context_settings=SETTINGS, epilog=epilogue(cmd_name))(stand_in(COMMANDS[cmd_name]))
        return typer.main.get_command(single)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """All commands in their groups, each with its whole first sentence."""
        for group, names in GROUPS.items():
            rows = [(name, _first_sentence(self.get_command(ctx, name).help)) for name in names]
            with formatter.section(group):
                formatter.write_dl(rows)

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run the command; a wrong option is an InputError like any other wrong input: one line."""
        try:
            status = super().main(*args, **extra | {"standalone_mode": False, "prog_name": "msl-fem"})
        except Exception as err:
            if not hasattr(err, "format_message"):  # what the parser of options raises has one, nothing else does
                raise
            raise InputError(_usage(err)) from err
        sys.exit(status if isinstance(status, int) else 0)


def stand_in(place: str) -> Any:
    """A function with the signature and the docstring of a command, which imports its module when it is called.

    The module's source is parsed, not run: of its imports only those count that cost nothing (`LIGHT`), so a
    command's options may name nothing else.
    """
    module, _, name = place.partition(":")
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    body = ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body
    [function] = [node for node in body if isinstance(node, ast.FunctionDef) and node.name == name]
    imports = [node for node in body if isinstance(node, ast.ImportFrom | ast.Import) and _imported(node) <= LIGHT]
    function.body = [*function.body[:1], *ast.parse("return _run(locals())").body]
    names: dict[str, Any] = {"_run": lambda options: getattr(import_module(module), name)(**options)}
    exec(compile(ast.Module([*imports, function], []), spec.origin, "exec"), names)
    return names[name]


def _imported(node: ast.Import | ast.ImportFrom) -> set[str]:
    return {str(node.module)} if isinstance(node, ast.ImportFrom) else {alias.name for alias in node.names}


def _first_sentence(text: str) -> str:
    """The first sentence of a docstring, without its full stop."""
    return re.split(r"\.(?:\s|$)", " ".join(text.split()), maxsplit=1)[0]


def _usage(err: Any) -> str:
    """What is wrong with the options, the value where it is known, and where the right ones are listed."""
    details: list[Any] = getattr(err.__cause__, "errors", list)()
    value = f", not {details[0]['input']!r}" if details and "input" in details[0] else ""
    command = err.ctx.command_path if getattr(err, "ctx", None) else "msl-fem"
    said = err.format_message().rstrip(".")
    named = re.fullmatch(r"No such command '(.*)'", said)
    near = get_close_matches(named[1], COMMANDS, n=1, cutoff=0.5) if named else []
    meant = f" is {near[0]} meant?" if near else ""
    return f"{said}{value};{meant} '{command} --help' lists what there is"


app = typer.Typer(
    cls=LazyCommands,
    name="msl-fem",
    help="Magnetic-levitation actuators: from a section of iron and copper to a guarded controller.",
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=SETTINGS,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"msl-fem {import_module('msl_fem').__version__}")
        typer.echo(import_module("msl_fem.cli.doctor").versions_that_matter())
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context, version: bool = typer.Option(False, "--version", callback=_version, is_eager=True)
) -> None:
    """Magnetic-levitation actuators: from a section of iron and copper to a guarded controller."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(2)

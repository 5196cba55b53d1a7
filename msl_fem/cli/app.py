"""The commands by name; a command's module is imported when it is called, so that a look-up need not load a mesher."""

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

COMMANDS = {
    "study": "msl_fem.cli.study",
    "solve": "msl_fem.cli.solve",
    "table": "msl_fem.cli.table",
    "lookup": "msl_fem.cli.lookup",
    "map": "msl_fem.cli.map",
    "guard": "msl_fem.cli.guard",
    "simulate": "msl_fem.cli.simulate",
    "identify": "msl_fem.cli.identify",
    "control": "msl_fem.cli.control",
}
"""Command to module; the module's `command` is the function."""
SETTINGS = {"help_option_names": ["-h", "--help"]}


class LazyCommands(TyperGroup):
    """The group of all commands, none of them loaded before it is asked for."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS:
            return None
        single = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, add_completion=False)
        single.command(cmd_name, context_settings=SETTINGS)(import_module(COMMANDS[cmd_name]).command)
        return typer.main.get_command(single)


app = typer.Typer(
    cls=LazyCommands,
    name="msl-fem",
    help="Magnetic-levitation actuators: from a section of iron and copper to a guarded controller.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=SETTINGS,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"msl-fem {import_module('msl_fem').__version__}")
        raise typer.Exit


@app.callback()
def options(version: bool = typer.Option(False, "--version", callback=_version, is_eager=True)) -> None:
    """Magnetic-levitation actuators: from a section of iron and copper to a guarded controller."""

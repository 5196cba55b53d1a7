"""The commands by name; a command's module is imported when it is called, so that a look-up need not load a mesher."""

import sys
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

from msl_fem.errors import InputError

COMMANDS = {
    "study": "msl_fem.cli.study",
    "solve": "msl_fem.cli.solve",
    "table": "msl_fem.cli.table",
    "lookup": "msl_fem.cli.lookup",
    "map": "msl_fem.cli.map",
    "guard": "msl_fem.cli.guard",
    "losses": "msl_fem.cli.losses",
    "size": "msl_fem.cli.size",
    "simulate": "msl_fem.cli.simulate",
    "bench": "msl_fem.cli.bench",
    "import": "msl_fem.cli.import_log",
    "identify": "msl_fem.cli.identify",
    "control": "msl_fem.cli.control",
    "compare": "msl_fem.cli.compare",
    "export": "msl_fem.cli.export",
    "flexure": "msl_fem.cli.flexure",
    "gap-trade": "msl_fem.cli.gap_trade",
    "tolerances": "msl_fem.cli.tolerances",
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

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run the command; a wrong option is an InputError like any other wrong input: one line."""
        try:
            status = super().main(*args, **extra | {"standalone_mode": False, "prog_name": "msl-fem"})
        except Exception as err:
            if not hasattr(err, "format_message"):  # what the parser of options raises has one, nothing else does
                raise
            raise InputError(_usage(err)) from err
        sys.exit(status if isinstance(status, int) else 0)


def _usage(err: Any) -> str:
    """What is wrong with the options, the value where it is known, and where the right ones are listed."""
    details: list[Any] = getattr(err.__cause__, "errors", list)()
    value = f", not {details[0]['input']!r}" if details and "input" in details[0] else ""
    command = err.ctx.command_path if getattr(err, "ctx", None) else "msl-fem"
    return f"{err.format_message().rstrip('.')}{value}; '{command} --help' lists what there is"


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
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context, version: bool = typer.Option(False, "--version", callback=_version, is_eager=True)
) -> None:
    """Magnetic-levitation actuators: from a section of iron and copper to a guarded controller."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(2)

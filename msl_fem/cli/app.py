"""The commands by name; a command's module is imported when it is called, so that a look-up need not load a mesher."""

import ast
import contextlib
import sys
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
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
    "diagnose": "msl_fem.cli.diagnose",
    "export": "msl_fem.cli.export",
    "flexure": "msl_fem.cli.flexure",
    "gap-trade": "msl_fem.cli.gap_trade",
    "tolerances": "msl_fem.cli.tolerances",
    "doctor": "msl_fem.cli.doctor",
}
"""Command to module; the module's `command` is the function."""
SETTINGS = {"help_option_names": ["-h", "--help"]}


class LazyCommands(TyperGroup):
    """The group of all commands, none of them loaded before it is asked for.

    Lists of commands (help, completion) take a command's first sentence from its source: who presses a key does not
    wait for a mesher.
    """

    _by_name_alone = False

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS:
            return None
        single = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, add_completion=False)
        function = _stand_in(COMMANDS[cmd_name]) if self._by_name_alone else import_module(COMMANDS[cmd_name]).command
        single.command(cmd_name, context_settings=SETTINGS)(function)
        return typer.main.get_command(single)

    @contextlib.contextmanager
    def _listing(self) -> Iterator[None]:
        self._by_name_alone = True
        try:
            yield
        finally:
            self._by_name_alone = False

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with self._listing():
            super().format_commands(ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        with self._listing():
            return super().shell_complete(ctx, incomplete)

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run the command; a wrong option is an InputError like any other wrong input: one line."""
        try:
            status = super().main(*args, **extra | {"standalone_mode": False, "prog_name": "msl-fem"})
        except Exception as err:
            if not hasattr(err, "format_message"):  # what the parser of options raises has one, nothing else does
                raise
            raise InputError(_usage(err)) from err
        sys.exit(status if isinstance(status, int) else 0)


def _stand_in(module: str) -> Any:
    """A function with the docstring of the module's `command`, found without importing the module."""

    def nothing() -> None: ...

    spec = find_spec(module)
    if spec is not None and spec.origin is not None:
        body = ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body
        found = [node for node in body if isinstance(node, ast.FunctionDef) and node.name == "command"]
        nothing.__doc__ = ast.get_docstring(found[0]) if found else None
    return nothing


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
        typer.echo(import_module("msl_fem.cli.installation").versions_that_matter())
        raise typer.Exit


@app.callback()
def options(
    context: typer.Context, version: bool = typer.Option(False, "--version", callback=_version, is_eager=True)
) -> None:
    """Magnetic-levitation actuators: from a section of iron and copper to a guarded controller."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(2)

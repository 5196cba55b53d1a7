"""The command line `msl-fem`: a thin layer over the package's functions."""

import sys

import typer

from msl_fem.cli import field
from msl_fem.cli.output import run_guarded

app = typer.Typer(
    name="msl-fem",
    help="Magnetic-levitation actuators: from a section of iron and copper to a guarded controller.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (field.solve, field.table, field.lookup):
    app.command()(command)


def main() -> None:
    """Run the command line and leave with its exit status."""
    sys.exit(run_guarded(app))

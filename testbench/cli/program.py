"""The commands of the command line, each imported when it is called."""

import os
from collections.abc import Sequence
from importlib import import_module
from typing import Annotated

import typer

from testbench import __version__
from testbench.workflows.options import ProjectCommand

COMMANDS = {
    "new": "Make an arm's folder from a robot's URDF or MJCF.",
    "check": "Check an arm's folder, and list what to confirm.",
    "plan": "Choose the poses to measure, and predict the error that remains.",
    "simulate": "Simulate readings of an arm in given poses.",
    "data": "Read a file of readings, and show what was understood.",
    "identify": "Identify stiffness models from readings without and with a load.",
    "calibrate": "Calibrate an arm by absolute readings: geometry, joint errors, compliances.",
    "export": "Write the identified geometry into the robot's URDF.",
    "predict": "Predict the deflection under loads, with intervals and stiffness.",
    "compensate": "Correct a robot's program for the deflection under loads.",
    "demo": "Calibrate a heavy arm in simulation.",
    "bench": "Rank your estimators beside others in frozen tasks.",
    "compare": "Compare two runs: which errs less, and which inputs differ.",
    "view": "Open the newest recording of a run in the Rerun viewer.",
}
"""What there is, one module each, and its line of help."""
GROUPS = ("data",)  #: Those that have commands of their own.
TYPED = ("COMP_WORDS", "_TYPER_COMPLETE_ARGS")  #: Where a shell that completes says what was typed.


def program(arguments: Sequence[str]) -> typer.Typer:
    """Make the command with what the arguments ask for; of all others the line of help alone.

    So that `testbench --help` imports neither MuJoCo nor Pinocchio nor Rerun.

    Args:
        arguments: Of the command line; the first one names the command.
    """
    app = typer.Typer(help="Virtual calibration cell for heavy robot arms.", callback=_options)
    named = list(arguments[:1]) or " ".join(os.environ.get(name, "") for name in TYPED).split()[1:2]
    for name, line in COMMANDS.items():
        module = import_module(f"testbench.cli.{name}") if name in named else None
        if module is not None and name in GROUPS:
            app.add_typer(module.group, name=name, help=line)
        else:
            command = module.command if module is not None else _elsewhere
            app.command(name, help=line, cls=ProjectCommand)(command)
    return app


def _elsewhere() -> None:
    """Stands for a command that was not asked for."""


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"testbench {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Flags of the program itself."""

"""The `testbench` command: an engineer's own arm and own data, and the recordings of any run."""

import sys
from collections.abc import Sequence
from importlib import import_module

import typer

from testbench.shell import command

COMMANDS = {
    "check": "Read an arm's folder; say what is in it, or what is wrong.",
    "elastic": "Write the elastic arm as MJCF for MuJoCo's own viewer.",
    "plan": "Choose the poses to measure; say what they promise.",
    "simulate": "Measure the true arm in given poses.",
    "identifiability": "Say what runs can tell of a model, and what would help.",
    "identify": "Identify stiffness models from measured runs.",
    "demo": "Calibrate a heavy arm in simulation.",
    "view": "Open the newest recording of a run in the Rerun viewer.",
    "shot": "Render the newest recording of a run without a screen.",
}
"""What there is, one module each, and its line of help."""


def program(arguments: Sequence[str]) -> typer.Typer:
    """The command with what the arguments ask for; of all else the line of help alone.

    So that `testbench --help` imports neither MuJoCo nor Pinocchio nor Rerun.

    Args:
        arguments: Of the command line; the first one names the command.
    """
    app = typer.Typer(add_completion=False, help="Virtual calibration cell for heavy robot arms.")
    for name, line in COMMANDS.items():
        asked = name in arguments[:1]
        body = import_module(f"{__name__}.{name}").command if asked else _elsewhere
        app.command(name, help=line)(body)
    return app


def _elsewhere() -> None:
    """Stands for a command that was not asked for."""


def main() -> None:
    """Entry point of the command."""
    sys.exit(command.run(program(sys.argv[1:])))

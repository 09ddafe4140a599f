"""The `testbench` command: an engineer's own arm and own data, and the recordings of any run."""

import gc
import sys

from testbench.shell import interrupt

GARBAGE = 50_000  #: Objects between two searches for garbage: looking every 700 is a tenth of short commands.


def main() -> None:
    """Entry point of the command."""
    interrupt.handle(interrupt.leave_at_once)
    from testbench.shell.surroundings import undisturbed  # here: it imports numpy

    undisturbed()
    gc.set_threshold(GARBAGE)
    from testbench.cli.program import program  # here: imports can be interrupted from now on
    from testbench.shell import command

    interrupt.leave(command.run(program(sys.argv[1:])))

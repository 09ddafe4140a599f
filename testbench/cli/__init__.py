"""The `testbench` command: an engineer's own arm and own data, and the recordings of any run."""

import gc
import sys

from testbench.runs import interrupt

GARBAGE = 50_000  #: Objects between two searches for garbage: looking every 700 is a tenth of short commands.


def main() -> None:
    """Entry point of the command."""
    interrupt.handle(interrupt.leave_at_once)
    from testbench.runs.surroundings import undisturbed  # here: it imports numpy

    undisturbed()
    gc.set_threshold(GARBAGE)
    from testbench.cli.program import program  # here: imports can be interrupted from now on
    from testbench.runs import command

    interrupt.leave(command.run(program(sys.argv[1:])))

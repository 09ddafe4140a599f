"""The `testbench` command: an engineer's own arm and own data, and the recordings of any run."""

import gc
import sys

from testbench.runs import interrupt

GARBAGE = 200_000  #: Objects between two searches for garbage: every 700 they take a tenth of a command.


def main() -> None:
    """Run the command."""
    interrupt.handle(interrupt.leave_at_once)
    gc.set_threshold(GARBAGE)
    from testbench.runs import command  # here: imports can be interrupted from now on

    command.undisturbed()
    from testbench.cli.predict import program

    interrupt.leave(command.run(program(sys.argv[1:])))

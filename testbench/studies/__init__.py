"""The paper's studies: each makes its trials, its report and the words for people."""

from importlib import import_module

from testbench.shell import interrupt
from testbench.shell.surroundings import undisturbed


def main(name: str) -> None:
    """Run a study from the command line's arguments, and end the program.

    Args:
        name: Of its folder.
    """
    interrupt.handle(interrupt.leave_at_once)
    undisturbed()
    from testbench.shell import command  # here: imports can be interrupted from now on
    from testbench.studies.run import app

    study = import_module(f"testbench.studies.{name}.study").STUDY
    interrupt.leave(command.run(app(study)))

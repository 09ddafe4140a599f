"""The paper's studies: each makes its trials, its report and the words for people."""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from testbench.shell import interrupt
from testbench.shell.surroundings import undisturbed

if TYPE_CHECKING:
    from testbench.studies.study import AnyStudy


def find_study(name: str) -> "AnyStudy":
    """Find a study by the name of its scenario: a folder of its own, or a preset of a campaign.

    Args:
        name: Of the scenario.

    Raises:
        ImportError: When there is none.
    """
    preset = f"{__name__}.campaign.presets.{name}"
    study: AnyStudy = import_module(preset if find_spec(preset) else f"{__name__}.{name}.study").STUDY
    return study


def main(name: str) -> None:
    """Run a study from the command line's arguments, and end the program.

    Args:
        name: Of its scenario.
    """
    interrupt.handle(interrupt.leave_at_once)
    undisturbed()
    from testbench.shell import command  # here: imports can be interrupted from now on
    from testbench.studies.run import app

    interrupt.leave(command.run(app(find_study(name))))

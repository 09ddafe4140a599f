"""The paper's studies and ours: each makes its trials, its report and its pictures."""

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING

from testbench.runs import interrupt

if TYPE_CHECKING:
    from testbench.studies.study import AnyStudy

HOMES: Mapping[str, str] = {
    "single_link": "paper.single_link",
    "six_dof_arm": "paper.six_dof_arm",
    "solver_comparison": "paper.solver_comparison",
    "loaded_stiffness": "paper.loaded_stiffness",
    "absolute_calibration": "absolute.simulated",
    "real_ur10": "absolute.real",
    "pose_selection": "planning",
    "compensation": "compensation",
    "bench": "bench",
}
"""Modules of studies by the names of their scenarios; all others are campaigns."""


def find_study(name: str) -> "AnyStudy":
    """Find a study by the name of its scenario.

    Args:
        name: Of the scenario.

    Raises:
        ImportError: When there is none.
    """
    home = HOMES.get(name, f"campaign.{name}")
    study: AnyStudy = import_module(f"testbench.studies.{home}").STUDY
    return study


def main(name: str) -> None:
    """Run a study from the command line's arguments, and end the program.

    Args:
        name: Of its scenario.
    """
    interrupt.handle(interrupt.leave_at_once)
    from testbench.runs import command  # here: imports can be interrupted from now on

    command.undisturbed()
    from testbench.studies.run import app

    interrupt.leave(command.run(app(find_study(name))))

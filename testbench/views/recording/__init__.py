"""Studies as Rerun recordings: views of report.json, never an input. The only importer of rerun.

One layout a kind of study, one module a layout; `stream`, `style` and the rest are what they share.
"""

from testbench.views.recording.calibration import write_calibration
from testbench.views.recording.plan import PlanScene, write_plan
from testbench.views.recording.single_link import write_single_link
from testbench.views.recording.solver import write_solver
from testbench.views.recording.sweep import Point, Sweep, write_sweep

__all__ = [
    "PlanScene",
    "Point",
    "Sweep",
    "write_calibration",
    "write_plan",
    "write_single_link",
    "write_solver",
    "write_sweep",
]

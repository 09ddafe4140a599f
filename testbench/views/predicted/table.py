"""predictions.csv: a row a pose and point, SI units."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbench.arm.folder import Joint
from testbench.bench.prediction import Predicted
from testbench.data.cells import as_cell
from testbench.errors import Array
from testbench.output.whole import whole_file

AXES = ("x", "y", "z")


def prediction_columns(joints: Sequence[Joint]) -> list[str]:
    """The header of predictions.csv, in order; docs/formats.md says what each holds."""
    names = ["pose", "line", "point", *(joint.column for joint in joints)]
    names += [f"{axis}_m" for axis in AXES]
    names += [f"{what}_{axis}_m" for what in ("position_half_95", "deflection", "half_95") for axis in AXES]
    names += [f"rotation_{axis}_rad" for axis in AXES]
    return [*names, *(f"stiffness_{k}_N_per_m" for k in (1, 2, 3)), *(f"softest_{axis}" for axis in AXES)]


def write_predictions(made: Predicted, path: Path) -> None:
    """All poses and points of a prediction; what nothing has seen, and what does not give, is blank."""
    found, tool = made.found, made.stiffness
    of_tool = np.hstack([found.turn, tool.principal, tool.softest])
    parts = (found.position, found.position_half, found.deflection, found.half)
    names = [as_cell(name) for name in made.names]
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(prediction_columns(made.model.arm.joints))
        for k, label in enumerate(made.asked.labels):
            first = [as_cell(label), str(made.asked.line[k])]
            joints, last = [*map(repr, made.asked.q[k].tolist())], _cells(of_tool[k])
            for m, name in enumerate(names):
                own = _cells(*(values[k, m] for values in parts))
                rows.writerow([*first, name, *joints, *own, *last])


def _cells(*values: Array) -> list[str]:
    """Ten digits of each, blank where infinite."""
    return [f"{x:.10g}" if np.isfinite(x) else "" for part in values for x in part.tolist()]

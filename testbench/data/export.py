"""Measured runs read from a text file as it comes from an instrument, a spreadsheet or a robot."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import Column, Columns, find_columns
from testbench.data.conditions import Conditions, read_conditions
from testbench.data.dataset import Dataset, Mask
from testbench.data.mapping import Frame, read_map
from testbench.data.names import ENTRIES, WHEN, XYZ, Slot
from testbench.data.pairing import HELD, Paired, pair
from testbench.data.sightings import Sightings, drop_other_points, read_sightings
from testbench.data.table import read_table
from testbench.errors import Array, InputError

SIGMA = 50e-6  #: Standard deviation of a reading where nobody says it [m].
SIGMA_RANGE = (1e-9, 1e-2)
"""Standard deviations that an instrument can have [m, rad]: beyond them a unit is wrong."""


@dataclass(frozen=True)
class Export:
    """A file that was read, and how it was understood."""

    data: Dataset  #: The runs.
    frame: Frame | None  #: What the readings are in, by the map; None where it does not say.
    columns: Columns  #: Which column says what.
    notes: tuple[str, ...]  #: What was assumed, left out or numbered; none for a file that says it all.


def read_export(path: Path, arm: Arm, mapping: Path | None = None, sigma: float | None = None) -> Export:
    """Read and check the runs of an arm.

    Args:
        path: The file; docs/formats.md has an example of every form.
        arm: The arm that was measured.
        mapping: A map of its names, TOML; None where it uses ours.
        sigma: Standard deviation of a reading along an axis [m], where neither file nor map has one.

    Raises:
        InputError: Names line and column, or key of the map, and what was expected.
    """
    names = read_map(mapping, arm)
    table = read_table(path, lambda name: names.find(name) is not None, names.layout)
    return runs_of(find_columns(table, names, arm), arm, sigma)


def runs_of(columns: Columns, arm: Arm, sigma: float | None) -> Export:
    """The same of columns that were found."""
    if not columns.table.rows:
        raise columns.table.error(0, "", "expected at least one row")
    columns, dropped = drop_other_points(columns)
    conditions = read_conditions(columns, arm)
    seen = read_sightings(columns, arm, conditions.loaded)
    runs = pair(columns.table, conditions, seen)
    _check_once(columns, conditions, runs, seen)
    lost = np.asarray((np.isnan(runs.before) | np.isnan(runs.after)).any(axis=-1))
    said, sigma_note = _sigma(columns, 0, sigma)
    turned = _rotations(columns, runs)
    precision = _precision(columns, seen, runs, lost)
    if precision is None and lost.any():
        precision = np.where(lost[..., None, None], 0.0, np.eye(3) / (2 * said**2))
    data = Dataset(
        markers=seen.markers,
        run=runs.run,
        pose=conditions.pose[runs.row],
        q=conditions.q[runs.row],
        wrench=conditions.wrench[runs.row],
        point=conditions.point[runs.row],
        before=np.where(lost[..., None], 0.0, runs.before),
        after=np.where(lost[..., None], 0.0, runs.after),
        sigma=said,
        rotation_before=turned[0] if turned else None,
        rotation_after=turned[1] if turned else None,
        sigma_rotation=_sigma(columns, 1, None)[0] if turned else None,
        precision=precision,
        station=None if conditions.station is None else conditions.station[runs.row],
    )
    notes = [*conditions.notes, *runs.notes, *sigma_note]
    notes += [f"{dropped} rows of points that the map calls no markers are left out"] * bool(dropped)
    return Export(data, columns.names.frame, columns, tuple(notes))


def _check_once(columns: Columns, conditions: Conditions, runs: Paired, seen: Sightings) -> None:
    """What holds for a run is the same in all of its rows."""
    every, lead = {"pose": conditions.pose[:, None], "joint": conditions.q}, runs.leader
    if seen.paired:
        every |= {"force": conditions.wrench[:, :3], "moment": conditions.wrench[:, 3:]}
        every |= {"mass": conditions.wrench[:, 2:3], "point": conditions.point}
        if conditions.station is not None:
            every["station"] = conditions.station[:, None]
    turned = [(column, columns.full(column)) for column in columns.every("rotation") if column.slot.when]
    for column, own in [(c, every[c.slot.what][:, c.slot.index]) for c in columns.every(*every)] + turned:
        slack = HELD if not seen.paired else 0.0
        differs = np.flatnonzero(np.abs(own - own[lead]) > slack)
        if len(differs):
            problem = "expected the same value in every row of the run"
            raise columns.table.error(differs[0], column.name, problem)


def _sigma(columns: Columns, index: int, flag: float | None) -> tuple[float, list[str]]:
    """Standard deviation of a reading of positions (0) [m] or orientations (1) [rad]."""
    slot, name = Slot("sigma", index), ("sigma_m", "sigma_rad")[index]
    column, stated, table = columns.get(slot), columns.constant(slot), columns.table
    low, high = SIGMA_RANGE
    if column is None:
        if flag is not None and stated is not None:
            raise InputError(
                columns.names.path or table.path, f"values.{name}", "expected it once, got a flag too"
            )
        value = flag if flag is not None else stated
        if value is None and index:
            raise columns.lack([name])
        if value is not None and not low <= value <= high:
            raise InputError(
                columns.names.path or table.path, name, f"expected {low:g} to {high:g}, got {value:g}"
            )
        assumed = f"no column says how far readings scatter: sigma {1e6 * SIGMA:g} um is assumed"
        return (SIGMA, [assumed]) if value is None else (value, [])
    values = columns.full(column)
    other = np.flatnonzero(values != values[0])
    if len(other):
        raise table.error(other[0], column.name, "expected one value in the whole file")
    if not low <= values[0] <= high:
        raise table.error(0, column.name, f"expected {low:g} to {high:g}, got {values[0]:g}")
    if flag is not None:
        raise table.error(0, column.name, "expected sigma once, got a flag too")
    return float(values[0]), []


def _rotations(columns: Columns, runs: Paired) -> tuple[Array, Array] | None:
    """Orientations of every run, unloaded and loaded, (runs, 3) [rad]; None where there are none."""
    found = {(c.slot.when, c.slot.index): c for c in columns.every("rotation") if c.slot.when}
    has_sigma = Slot("sigma", 1) in columns.found
    if not found and not has_sigma:
        return None
    missing = [
        f"rotation_{when}_{axis}_rad" for when in WHEN for k, axis in enumerate(XYZ) if (when, k) not in found
    ]
    if missing:
        raise columns.lack(missing)
    before, after = (
        np.column_stack([columns.full(found[when, k])[runs.row] for k in range(3)]) for when in WHEN
    )
    return before, after


def _precision(columns: Columns, seen: Sightings, runs: Paired, lost: Mask) -> Array | None:
    """Inverse covariances, (runs, m, 3, 3) [1/m^2], zero where the target was lost; None without columns."""
    found = {c.slot.index: c for c in columns.every("covariance")}
    if not found:
        return None
    table = columns.table
    missing = [f"deflection_cov_{name}_m2" for k, name in enumerate(ENTRIES) if k not in found]
    if missing:
        raise columns.lack(missing)
    if not (seen.long and seen.paired):
        problem = "covariances: expected a line for every marker of a run, with both readings"
        raise InputError(table.path, f"line {table.header}", problem)
    of_row, marker = np.searchsorted(runs.row, runs.leader), seen.marker[: table.rows]
    gone = lost[of_row, marker]
    C = np.tile(np.eye(3), (table.rows, 1, 1))
    for k, (a, b) in enumerate(ENTRIES.values()):
        own = np.where(gone, C[:, a, b], _seen_values(columns, found[k], gone))
        C[:, a, b] = C[:, b, a] = own
    bad = np.flatnonzero(~(np.linalg.eigvalsh(C)[:, 0] > 0))
    if len(bad):
        problem = f"expected a positive definite covariance, got {C[bad[0]].tolist()} m^2"
        raise table.error(bad[0], "", problem)
    P = np.asarray(np.linalg.inv(C))
    P[gone] = 0
    placed = np.zeros((*lost.shape, 3, 3))
    placed[of_row, marker] = (P + P.swapaxes(1, 2)) / 2
    return placed


def _seen_values(columns: Columns, column: Column, gone: Mask) -> Array:
    values = columns.values(column)
    blank = np.flatnonzero(np.isnan(values) & ~gone)
    if len(blank):
        raise columns.table.error(blank[0], column.name, "expected a finite number, got ''")
    return values

"""Reader of measured runs from a text file of an instrument, a spreadsheet or a robot."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, in_order
from testbench.errors import Array, Ids, Mask, check_type
from testbench.files.columns import Columns, find_columns, read_columns
from testbench.files.mapping import Map, read_map
from testbench.files.names import ENTRIES, Slot, columns_of
from testbench.files.pair import HELD, Paired, pair
from testbench.files.readings import FileReadings, average_shots, markers_only, read_readings
from testbench.files.rows import RowConditions, read_conditions
from testbench.files.scatter import read_covariances, read_scatter
from testbench.files.table import table_of


@dataclass(frozen=True)
class Export:
    """Hold a file that was read, and how it was understood."""

    data: Dataset  #: The runs.
    columns: Columns  #: Meaning of its columns.
    notes: tuple[str, ...]  #: Assumptions, omissions and numbering; empty for a complete file.


def read_csv(path: str | Path, arm: Arm) -> Dataset:
    """Read and check a dataset of an arm.

    Args:
        path: The file: `testbench.files.write.write_csv` documents ours, docs/formats.md every other form.
        arm: The arm that was measured.

    Returns:
        Readings before and after loading, with poses and loads.

    Raises:
        InputError: Names the line and what was expected.
        BenchError: When arm is no Arm.
    """
    check_type(arm, Arm, "arm")
    return read_export(Path(path), arm).data


def read_export(
    path: Path,
    arm: Arm,
    mapping: Path | Map | None = None,
    sigma: float | None = None,
    load: float | None = None,
) -> Export:
    """Read and check the runs of an arm.

    Args:
        path: The file; docs/formats.md has an example of every form.
        arm: The arm that was measured.
        mapping: A map of its names, or its TOML file; None if it uses ours.
        sigma: Standard deviation of a reading along an axis [m], if neither file nor map has one.
        load: Mass of the payload in loaded rows [kg], if neither file nor map has a load.

    Returns:
        The runs, and how the file was understood.

    Raises:
        InputError: Names line and column, or key of the map, and what was expected.
    """
    names = replace(read_map(mapping, arm), load=load)
    return runs_of(read_columns(path, names, arm), arm, sigma)


def from_text(text: str, arm: Arm) -> Dataset:
    """Read runs of an arm from the text that `write.csv_text` makes.

    Args:
        text: The text.
        arm: The arm.

    Returns:
        The runs.
    """
    names = read_map(None, arm)
    table = table_of(Path("runs"), (text, "utf-8"), names.knows, names.map.file)
    return runs_of(find_columns(table, names, arm), arm, None).data


def runs_of(columns: Columns, arm: Arm, sigma: float | None) -> Export:
    """Convert the columns of a file to runs.

    Args:
        columns: The columns.
        arm: The arm that was measured.
        sigma: Standard deviation of a reading along an axis [m], if neither file nor map has one.

    Returns:
        The runs, and how the file was understood.

    Raises:
        InputError: Names line and column, or key of the map, and what was expected.
    """
    # Drop points that are no markers, and average shots.
    columns, dropped = markers_only(columns)
    columns, shots = average_shots(columns)
    # Conditions and positions of every row, then pairs of unloaded and loaded readings.
    conditions = read_conditions(columns, arm)
    read = read_readings(columns, arm, conditions.loaded)
    runs = pair(columns.table, conditions, read)
    _check_once(columns, conditions, runs, read)
    own = in_order(conditions, runs.row)
    # Noise: one sigma for the file, or a covariance per reading; lost targets have zero weight.
    lost = np.asarray((np.isnan(runs.before) | np.isnan(runs.after)).any(axis=-1))
    scatter, (before, after) = read_scatter(columns, sigma), _rotations(columns, runs.row)
    own_sigma = _of_the_file(columns, 0, scatter.sigma)
    precision = _precision(columns, read, runs, lost)
    if precision is None and lost.any():
        precision = np.where(lost[..., None, None], 0.0, np.eye(3) / (2 * own_sigma**2))
    data = Dataset(
        markers=read.markers,
        run=runs.run,
        pose=own.pose,
        q=own.q,
        wrench=own.wrench,
        point=own.point,
        before=np.where(lost[..., None], 0.0, runs.before),
        after=np.where(lost[..., None], 0.0, runs.after),
        sigma=own_sigma,
        rotation_before=before,
        rotation_after=after,
        sigma_rotation=None if before is None else _of_the_file(columns, 1, scatter.sigma_rotation),
        precision=precision,
        station=own.station,
        taken_off=own.taken_off,
    )
    notes = (*columns.warnings, *conditions.notes, *runs.notes, *scatter.notes, *dropped, *shots)
    return Export(data, columns, notes)


def _check_once(columns: Columns, conditions: RowConditions, runs: Paired, read: FileReadings) -> None:
    """Check that conditions of a run are equal in all of its rows."""
    every, lead = {"pose": conditions.pose[:, None], "joint": conditions.q}, runs.leader
    if conditions.taken_off is not None:
        every["loading"] = conditions.taken_off[:, None].astype(int)
    if read.paired:
        every |= {"force": conditions.wrench[:, :3], "moment": conditions.wrench[:, 3:]}
        every |= {"mass": conditions.wrench[:, 2:3], "point": conditions.point}
        if conditions.station is not None:
            every["station"] = conditions.station[:, None]
    turned = [(column, columns.full(column)) for column in columns.all_of("rotation") if column.slot.when]
    for column, own in [(c, every[c.slot.what][:, c.slot.index]) for c in columns.all_of(*every)] + turned:
        differs = np.abs(own - own[lead]) > (0.0 if read.paired else HELD)
        columns.table.refuse(differs, column.name, "expected the same value in every row of the run")


def _of_the_file(columns: Columns, index: int, values: Array) -> float:
    """Return one standard deviation of positions (0) or orientations (1) of a file, from (rows,) [m, rad]."""
    if column := columns.get(Slot("sigma", index)):
        columns.table.refuse(values != values[0], column.name, "expected one value in the whole file")
    return float(values[0])


def _rotations(columns: Columns, row: Ids) -> tuple[Array, Array] | tuple[None, None]:
    """Read orientations of every run, unloaded and loaded, (runs, 3) [rad]; None if there are none."""
    wanted = columns_of("rotation", "before") | columns_of("rotation", "after")
    found = columns.complete_set(wanted)
    if not found:
        if Slot("sigma", 1) in columns.found:
            raise columns.lack(list(wanted))
        return None, None
    if columns.source_of(Slot("sigma", 1)) is None:
        raise columns.lack(["sigma_rad"])
    values = np.column_stack([columns.full(column)[row] for column in found])
    return values[:, :3], values[:, 3:]


def _precision(columns: Columns, read: FileReadings, runs: Paired, lost: Mask) -> Array | None:
    """Compute inverse covariances, (runs, m, 3, 3) [1/m^2], zero for lost targets; None without columns."""
    table, C = columns.table, read_covariances(columns, "covariance")
    if C is None:
        return None
    if not (read.long and read.paired):
        raise table.header_error("covariances: expected a line for every marker of a run, with both readings")
    of_row, marker = np.searchsorted(runs.row, runs.leader), read.marker[: table.rows]
    gone = lost[of_row, marker]
    blank = np.isnan(C) & ~gone[:, None, None]
    for k, (a, b) in enumerate(ENTRIES.values()):
        name = columns.found[Slot("covariance", k)].name
        table.refuse(blank[:, a, b], name, "expected a finite number, got ''")
    C[gone] = np.eye(3)
    problem = "expected a positive definite covariance, got {} m^2"
    table.refuse(~(np.linalg.eigvalsh(C)[:, 0] > 0), "", lambda row: problem.format(C[row].tolist()))
    P = np.asarray(np.linalg.inv(C))
    P[gone] = 0
    placed = np.zeros((*lost.shape, 3, 3))
    placed[of_row, marker] = (P + P.swapaxes(1, 2)) / 2
    return placed

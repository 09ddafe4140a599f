"""Readings along lines in a file: travels of gauges and distances to fixed points, one marker per row."""

from dataclasses import dataclass

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, Ids, Mask
from testbench.files.columns import Columns, ReadColumn
from testbench.files.names import Slot, columns_of
from testbench.model.kinematics import build_vjm
from testbench.model.vjm import marker_points, tool_points

TILT, FIXED = np.radians(0.5), 1e-3
"""Standard deviations of a gauge's direction [rad] and of a fixed point [m] if the file states none."""
MAX_TILT, MAX_FIXED = np.radians(10), 0.1
"""Largest of these that are accepted [rad, m]: beyond them a unit is wrong."""


@dataclass(frozen=True)
class FileLines:
    """Hold the readings along lines of a table; rows of positions hold none."""

    number: Array  #: Readings unloaded and loaded, (2, rows) [m]; NaN in other rows, or where lost.
    gauge: Mask  #: Rows of gauges, (rows,).
    meter: Mask  #: Rows of distances, (rows,).
    direction: Array  #: Directions of gauges, unit vectors, (rows, 3) [1]; the x axis in other rows.
    tilt: Array  #: Their standard deviations, (rows,) [rad].
    fixed: Array  #: Fixed points of distances, (rows, 3) [m]; NaN in other rows.
    fixed_sigma: Array  #: Their standard deviations, (rows,) [m].
    notes: tuple[str, ...]  #: Assumptions that were made.

    @property
    def rows(self) -> Mask:
        """Tell which rows are readings along lines, (rows,)."""
        return self.gauge | self.meter


def read_lines(columns: Columns) -> FileLines | None:
    """Read travels and distances.

    Args:
        columns: The columns of the file.

    Returns:
        The readings; None without columns for them.

    Raises:
        InputError: Names line and column, and what was expected.
    """
    if not columns.all_of("travel", "distance"):
        return None
    table, notes = columns.table, list[str]()
    travel, distance = _numbers(columns, "travel"), _numbers(columns, "distance")
    (fixed, _), (direction, axes) = _triple(columns, "fixed"), _triple(columns, "direction")
    # What a row is: the one of the two kinds whose direction or fixed point it states.
    gauge, meter = (np.asarray(np.isfinite(own).all(axis=1)) for own in (direction, fixed))
    table.refuse(gauge & meter, axes[0] if axes else "", "expected a direction or a fixed point, got both")
    for read, own, what in (
        (travel, gauge, "direction_x, _y and _z"),
        (distance, meter, "fixed_x, _y and _z"),
    ):
        stray = np.asarray(np.isfinite(read).any(axis=0) & ~own)
        table.refuse(stray, "", f"expected {what} of this reading")
    length = np.linalg.norm(np.where(gauge[:, None], direction, 1.0), axis=1)
    table.refuse(np.asarray(length == 0), axes[0] if axes else "", "expected a direction, got 0, 0, 0")
    direction = np.where(gauge[:, None], direction / np.maximum(length, 1e-300)[:, None], (1.0, 0.0, 0.0))
    tilt = _deviation(columns, "tilt", gauge, (TILT, MAX_TILT), notes)
    fixed_sigma = _deviation(columns, "fixed_sigma", meter, (FIXED, MAX_FIXED), notes)
    number = np.where(gauge, travel, np.where(meter, distance, np.nan))
    kinds = (
        f"{gauge.sum()} travels of gauges" * bool(gauge.any()),
        f"{meter.sum()} distances" * bool(meter.any()),
    )
    notes.insert(0, f"{' and '.join(filter(None, kinds))}: one number each, along a line")
    return FileLines(number, gauge, meter, direction, tilt, fixed, fixed_sigma, tuple(notes))


def _numbers(columns: Columns, what: str) -> Array:
    """Read a quantity unloaded and loaded, (2, rows) [m]; a gauge without unloaded readings was zeroed."""
    loaded, unloaded = columns.get(Slot(what, when="after")), columns.get(Slot(what, when="before"))  # type: ignore[arg-type]
    if loaded is None and unloaded is None:
        return np.full((2, columns.table.rows), np.nan)
    if loaded is None or (unloaded is None and what == "distance"):
        raise columns.lack([f"{what}_{'after' if loaded is None else 'before'}_m"])
    last = columns.values(loaded)
    first = np.where(np.isnan(last), np.nan, 0.0) if unloaded is None else columns.values(unloaded)
    return np.array([first, last])


def _triple(columns: Columns, what: str) -> tuple[Array, list[str]]:
    """Read a vector, (rows, 3), NaN where blank or missing; and the names of its columns."""
    found: list[ReadColumn] = columns.complete_set(columns_of(what))  # type: ignore[arg-type]
    if not found:
        return np.full((columns.table.rows, 3), np.nan), []
    return columns.together(found)[0], [column.name for column in found]


def _deviation(columns: Columns, what: str, own: Mask, usual: tuple[float, float], notes: list[str]) -> Array:
    """Read a standard deviation, (rows,), 0 in other rows; the usual one where nothing states it."""
    source = columns.source_of(Slot(what))  # type: ignore[arg-type]
    stated = columns.values(source) if isinstance(source, ReadColumn) else np.full(len(own), source or np.nan)
    stated = np.full(len(own), 0.0) if source == 0.0 else stated
    if (missing := own & np.isnan(stated)).any():
        words = {"tilt": "0.5 deg of direction", "fixed_sigma": "1 mm of a fixed point"}[what]
        notes.append(f"no column gives the uncertainty in {missing.sum()} rows: {words} is assumed")
    values = np.where(own, np.where(np.isnan(stated), usual[0], stated), 0.0)
    name = source.name if isinstance(source, ReadColumn) else what
    bad = ~((values >= 0) & (values <= usual[1]))
    columns.table.refuse(bad, name, lambda row: f"expected 0 to {usual[1]:.3g} rad or m, got {values[row]:g}")
    return values


@dataclass(frozen=True)
class PlacedLines:
    """Hold directions of the readings of every run and marker, as a dataset has them."""

    direction: Array  #: Unit vectors, (runs, m, 3) [1]; zero for positions and without an instrument.
    tilt: Array  #: Standard deviations, (runs, m) [rad].
    reach: Array  #: Lengths of distances, (runs, m) [m]; 0 for gauges.


def place_lines(
    lines: FileLines, arm: Arm, names: tuple[str, ...], q: Array, at: tuple[Ids, Ids]
) -> PlacedLines:
    """Arrange directions by run and marker; those of distances are towards the marker of the rigid arm.

    Args:
        lines: The readings.
        arm: The arm that was measured.
        names: Markers of the runs, m of them.
        q: Joints of the runs, (runs, n) [rad, m].
        at: Run and marker of every row, (rows,) each.

    Returns:
        Directions, tilts and reaches.
    """
    shape = len(q), len(names)
    direction, tilt, reach = np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape)
    direction[at] = np.where(lines.gauge[:, None], lines.direction, 0.0)
    tilt[at] = lines.tilt
    if lines.meter.any():
        vjm = build_vjm(arm)
        beam = tool_points(vjm, q, marker_points(vjm, names))[at] - lines.fixed
        length = np.linalg.norm(beam, axis=1)
        own = lines.meter
        runs, markers = at[0][own], at[1][own]
        direction[runs, markers] = beam[own] / length[own, None]
        reach[runs, markers] = length[own]
        tilt[runs, markers] = lines.fixed_sigma[own] / length[own]
    return PlacedLines(direction, tilt, reach)

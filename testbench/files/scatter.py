"""Noise of readings: one standard deviation for a file, one per row, or a covariance of each."""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.files.columns import Columns
from testbench.files.names import ENTRIES, ROTATIONS, Slot, What, columns_of

SIGMA = (50e-6, 2e-4)
"""Standard deviations of positions and of orientations if the file states none [m, rad]."""
SIGMA_RANGE = (1e-9, 1e-2)
"""Range of standard deviations of instruments [m, rad]: beyond it a unit is wrong."""
MAX_DEVIATION = 1.0
"""Largest standard deviation of a row [m, rad]: beyond it nothing was measured."""
MIN_DEVIATIONS = (1e-6, 1e-7)
"""Least standard deviations of a row that are accepted [m, rad]: no target is steadier."""


@dataclass(frozen=True)
class Scatter:
    """Hold the noise of every row of a table."""

    sigma: Array  #: Standard deviation of a position along an axis, (rows,) [m].
    sigma_rotation: Array  #: Standard deviation of an orientation about an axis, (rows,) [rad].
    #: Covariance of a position, (rows, 3, 3) [m^2]; None if sigma holds along every axis.
    covariance: Array | None
    notes: tuple[str, ...]  #: Assumptions that were made.


def read_scatter(columns: Columns, sigma: float | None) -> Scatter:
    """Read the noise of positions and orientations, from the file, the map or a flag.

    Args:
        columns: The columns of the file.
        sigma: Standard deviation per axis of one position [m]; None where no flag gives it.

    Returns:
        The noise [m, rad].

    Raises:
        InputError: At a number that no instrument has.
    """
    deviations, notes = _deviations(columns, "deviation", MIN_DEVIATIONS[0], "m")
    turned, more = _deviations(columns, "turn_deviation", MIN_DEVIATIONS[1], "rad")
    own, said = _read_sigma(columns, 0, sigma, deviations)
    own_turn, said_turn = _read_sigma(columns, 1, None, turned)
    covariance = read_covariances(columns, "spread")
    if covariance is None and deviations is not None:
        filled = np.where(np.isnan(deviations), own[:, None], deviations)
        covariance = filled[:, :, None] ** 2 * np.eye(3)
    elif (C := covariance) is not None:
        whole = np.asarray(~np.isnan(C).any(axis=(1, 2)))
        sound = np.asarray(~(np.abs(C) > MAX_DEVIATION**2).any(axis=(1, 2)) | ~whole)
        sound[whole & sound] = np.linalg.eigvalsh(C[whole & sound])[:, 0] >= SIGMA_RANGE[0] ** 2
        problem = "expected a positive definite covariance below 1 m^2, got {} m^2"
        columns.table.refuse(~sound, "", lambda row: problem.format(C[row].tolist()))
        covariance = np.where(np.isnan(C), own[:, None, None] ** 2 * np.eye(3), C)
    return Scatter(own, own_turn, covariance, (*notes, *more, *said, *said_turn))


def _read_sigma(
    columns: Columns, index: int, flag: float | None, deviations: Array | None = None
) -> tuple[Array, list[str]]:
    """Read the standard deviation of positions (0) or orientations (1) of every row.

    Args:
        columns: The columns of the file.
        index: 0 or 1.
        flag: Value for a file and map that state none [m, rad]; None for `SIGMA`.
        deviations: Standard deviations by axis in the file, (rows, 3) [m, rad].

    Returns:
        Standard deviations, (rows,) [m, rad], and notes on assumptions.

    Raises:
        InputError: At a number that no instrument has.
    """
    slot, name, table = Slot("sigma", index), ("sigma_m", "sigma_rad")[index], columns.table
    column, stated, (low, high) = columns.get(slot), columns.constant(slot), SIGMA_RANGE
    if column is not None:
        values = columns.full(column)
        bad = ~((values >= low) & (values <= high))
        table.refuse(bad, column.name, lambda row: f"expected {low:g} to {high:g}, got {values[row]:g}")
        return values, _unlike(flag, values)
    if deviations is not None and np.isfinite(deviations).any():
        values = np.full(table.rows, np.nanmedian(deviations))
        return values, _unlike(flag, values)
    value = flag if stated is None else stated
    if value is not None and not low <= value <= high:
        raise columns.map_error(name, f"expected {low:g} to {high:g}, got {value:g}")
    words = f"orientations: sigma {1e3 * SIGMA[1]:g} mrad" if index else f"sigma {1e6 * SIGMA[0]:g} um"
    asked = value is None and (not index or bool(columns.all_of(*ROTATIONS)))
    notes = [] if stated is None else _unlike(flag, np.array(stated))
    notes += [f"no column gives the noise: {words} is assumed"] * asked
    return np.full(table.rows, SIGMA[index] if value is None else value), notes


def _unlike(flag: float | None, used: Array) -> list[str]:
    """Note that the caller's sigma [m] is not used, if the file's or map's differs."""
    if flag is None or np.allclose(used, flag, rtol=1e-6, atol=0):
        return []
    return [f"sigma is that of the file or its map, not {1e6 * flag:g} um as was said"]


def _deviations(columns: Columns, what: What, least: float, unit: str) -> tuple[Array | None, list[str]]:
    """Read standard deviations by axis, (rows, 3) [m, rad], NaN if blank; None without such columns."""
    found = columns.complete_set(columns_of(what))
    if not found:
        return None, []
    values = np.column_stack([columns.values(column) for column in found])
    columns.table.refuse(
        (values < 0) | (values > MAX_DEVIATION),
        [column.name for column in found],
        lambda row, k: f"expected 0 to {MAX_DEVIATION:g} {unit}, got {values[row, k]:g} {unit}",
    )
    middle = float(np.nanmedian(values)) if np.isfinite(values).any() else least
    if middle > SIGMA_RANGE[1]:
        problem = f"expected at most {SIGMA_RANGE[1]:g} {unit}, got {middle:g} in most rows; another unit?"
        raise columns.table.error(0, found[0].name, problem)
    low = int((values < least).sum())
    words = f"{low} standard deviations below {1e6 * least:g} u{unit} are taken as that"
    return np.fmax(values, least) if low else values, [words] * bool(low)


def read_covariances(columns: Columns, what: What) -> Array | None:
    """Read the covariance of every row.

    Args:
        columns: The columns of the file.
        what: The quantity.

    Returns:
        Covariances, (rows, 3, 3) [m^2], NaN where blank; None without such columns.

    Raises:
        InputError: Where one of the columns is missing.
    """
    found = columns.complete_set(columns_of(what))
    if not found:
        return None
    C = np.empty((columns.table.rows, 3, 3))
    for column, (a, b) in zip(found, ENTRIES.values(), strict=True):
        C[:, a, b] = C[:, b, a] = columns.values(column)
    return C

"""How far absolute readings scatter: one number for a file, one a row, or a covariance of each."""

from dataclasses import dataclass

import numpy as np

from testbench.data.columns import Columns
from testbench.data.export import SIGMA, SIGMA_RANGE
from testbench.data.names import ENTRIES, ROTATIONS, XYZ, Slot, What
from testbench.errors import Array, InputError

SIGMA_ROTATION = 2e-4  #: Standard deviation of an orientation about an axis where nobody says it [rad].
MOST = 1.0  #: Largest standard deviation of a row [m, rad]: beyond it nothing was measured.
LEAST = (1e-6, 1e-7)
"""Least standard deviations of a row that are believed [m, rad]: no target stands stiller."""


@dataclass(frozen=True)
class Scatter:
    """Of every row of a table."""

    sigma: Array  #: Standard deviation of a position along an axis, (rows,) [m].
    sigma_rotation: Array  #: Of an orientation about an axis, (rows,) [rad].
    covariance: Array | None  #: Of a position, (rows, 3, 3) [m^2]; None where sigma says it all.
    notes: tuple[str, ...]  #: What was assumed.


def read_scatter(columns: Columns, sigma: float | None, sigma_rotation: float | None) -> Scatter:
    """How far positions and orientations scatter, by the file, the map or a flag [m, rad].

    Raises:
        InputError: At a number that no instrument has, and where two places say the same.
    """
    deviations, notes = _deviations(columns, "deviation", LEAST[0])
    turned, more = _deviations(columns, "turn_deviation", LEAST[1])
    own, said = _sigma(columns, 0, sigma, deviations, SIGMA)
    own_turn, said_turn = _sigma(columns, 1, sigma_rotation, turned, SIGMA_ROTATION)
    covariance = _covariance(columns)
    if covariance is None and deviations is not None:
        filled = np.where(np.isnan(deviations), own[:, None], deviations)
        covariance = filled[:, :, None] ** 2 * np.eye(3)
    elif covariance is not None:
        covariance = np.where(np.isnan(covariance), own[:, None, None] ** 2 * np.eye(3), covariance)
    return Scatter(own, own_turn, covariance, (*notes, *more, *said, *said_turn))


def _sigma(
    columns: Columns, index: int, flag: float | None, deviations: Array | None, assumed: float
) -> tuple[Array, list[str]]:
    """Standard deviation of positions (0) or orientations (1) of every row, (rows,) [m, rad]."""
    slot, name, table = Slot("sigma", index), ("sigma_m", "sigma_rad")[index], columns.table
    column, stated = columns.get(slot), columns.constant(slot)
    low, high = SIGMA_RANGE
    said = [x for x in (flag, stated) if x is not None]
    if len(said) + (column is not None) > 1:
        raise InputError(columns.names.path or table.path, name, "expected it once, got it in two places")
    if column is not None:
        values = columns.full(column)
        bad = np.flatnonzero(~((values >= low) & (values <= high)))
        if len(bad):
            raise table.error(bad[0], column.name, f"expected {low:g} to {high:g}, got {values[bad[0]]:g}")
        return values, []
    if deviations is not None and np.isfinite(deviations).any():
        return np.full(table.rows, np.nanmedian(deviations)), []
    if said:
        if not low <= said[0] <= high:
            problem = f"expected {low:g} to {high:g}, got {said[0]:g}"
            raise InputError(columns.names.path or table.path, name, problem)
        return np.full(table.rows, said[0]), []
    if index:
        words = f"orientations: sigma {1e3 * assumed:g} mrad" if columns.every(*ROTATIONS) else ""
    else:
        words = f"sigma {1e6 * assumed:g} um"
    notes = [f"no column says how far readings scatter: {words} is assumed"] if words else []
    return np.full(table.rows, assumed), notes


def _deviations(columns: Columns, what: What, least: float) -> tuple[Array | None, list[str]]:
    """Standard deviations by axis, (rows, 3) [m, rad], NaN where blank; None without such columns."""
    found = {c.slot.index: c for c in columns.every(what)}
    if not found:
        return None, []
    name, unit = ("sigma", "m") if what == "deviation" else ("sigma_rotation", "rad")
    missing = [f"{name}_{axis}_{unit}" for k, axis in enumerate(XYZ) if k not in found]
    if missing:
        raise columns.lack(missing)
    values = np.column_stack([columns.values(found[k]) for k in range(3)])
    wrong = np.argwhere((values < 0) | (values > MOST))
    if len(wrong):
        row, k = wrong[0]
        problem = f"expected 0 to {MOST:g} {unit}, got {values[row, k]:g} {unit}"
        raise columns.table.error(row, found[k].name, problem)
    middle = float(np.nanmedian(values)) if np.isfinite(values).any() else least
    if middle > SIGMA_RANGE[1]:
        problem = f"expected at most {SIGMA_RANGE[1]:g} {unit}, got {middle:g} in most rows; another unit?"
        raise columns.table.error(0, found[0].name, problem)
    low = int((values < least).sum())
    words = f"{low} standard deviations below {1e6 * least:g} u{unit} are taken as that"
    return np.fmax(values, least) if low else values, [words] * bool(low)


def _covariance(columns: Columns) -> Array | None:
    """Covariances of every row, (rows, 3, 3) [m^2], NaN where blank; None without such columns."""
    found = {c.slot.index: c for c in columns.every("spread")}
    if not found:
        return None
    missing = [f"position_cov_{name}_m2" for k, name in enumerate(ENTRIES) if k not in found]
    if missing:
        raise columns.lack(missing)
    C = np.empty((columns.table.rows, 3, 3))
    for k, (a, b) in enumerate(ENTRIES.values()):
        C[:, a, b] = C[:, b, a] = columns.values(found[k])
    whole = np.asarray(~np.isnan(C).any(axis=(1, 2)))
    most = np.abs(np.where(whole[:, None, None], C, np.eye(3))).max(axis=(1, 2), initial=0.0)
    sound = np.asarray(most <= MOST**2)
    sound[whole & sound] = np.linalg.eigvalsh(C[whole & sound])[:, 0] >= SIGMA_RANGE[0] ** 2
    bad = np.flatnonzero(~sound)
    if len(bad):
        problem = f"expected a positive definite covariance below 1 m^2, got {C[bad[0]].tolist()} m^2"
        raise columns.table.error(bad[0], "", problem)
    return C

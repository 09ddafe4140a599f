"""Absolute readings as CSV that `read_series` gives back: a row is one target of one reading, in SI units."""

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.cells import as_cell
from testbench.data.conditions import load_point, same_poses
from testbench.data.dataset import Mask
from testbench.data.names import ENTRIES, XYZ
from testbench.data.series import Series
from testbench.data.series_export import ALONE
from testbench.data.series_scatter import LEAST
from testbench.errors import Array, BenchError
from testbench.output.whole import write_whole

FORCE, MOMENT, POINT, PLACE, ROTATION, DEVIATION = (
    [pattern.format(x) for x in XYZ]
    for pattern in (
        "force_{}_N",
        "moment_{}_Nm",
        "point_{}_m",
        "position_{}_m",
        "rotation_{}_rad",
        "sigma_{}_m",
    )
)
SIGMA = ("sigma_m", "sigma_rad")
COVARIANCE = [f"position_cov_{name}_m2" for name in ENTRIES]
DIGITS = 4  #: Digits of standard deviations and covariances in a shortened file.


def write_series(
    path: str | Path, arm: Arm, series: Series | Sequence[Series], decimals: int | None = None
) -> None:
    """Write one or several series; an existing file is replaced only by a whole one.

    Columns whose value the reader would take by itself are left out: no load, the arm's load point, one
    marker, names that are the file's.

    Args:
        path: The file.
        arm: The arm that was measured.
        series: What is written, alike in targets and in what was read.
        decimals: Of positions [m], joints and angles [rad], loads and torques; None for numbers in full,
            which are read back bit by bit but for orientations (1e-15).

    Raises:
        BenchError: When series differ in their columns, or a target is not the arm's.
        InputError: When the file cannot be written.
    """
    every = [series] if isinstance(series, Series) else series
    write_whole(series_text(arm, every, Path(path).stem, decimals), Path(path))


def series_text(arm: Arm, series: Sequence[Series], stem: str, decimals: int | None = None) -> str:
    """The same as text, for a file of that name without its ending."""
    for s in series:
        if s.q.shape[1] != arm.n_joints:
            raise BenchError(f"joints: expected {arm.n_joints} of {arm.name}, got {s.q.shape[1]}")
        if s.markers != series[0].markers:
            raise BenchError(f"markers: expected {series[0].markers} in all of a file, got {s.markers}")
    silent, scatter = _silent(arm, series, stem), _scatter_columns(series)
    turned = next((s.sigma_rotation for s in series if s.sigma_rotation), None)
    if turned:
        series = [s if s.rotation is not None else _unturned(s, turned) for s in series]
    tables = [_table(arm, s, stem, decimals) | _scatter(s, scatter, decimals) for s in series]
    if any(list(table) != list(tables[0]) for table in tables):
        raise BenchError("series: expected torques, temperature and time in all of a file or in none")
    header = [name for name in tables[0] if name not in silent]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(as_cell, header))
    for table in tables:
        writer.writerows(zip(*(table[name] for name in header), strict=True))
    return text.getvalue()


def _silent(arm: Arm, series: Sequence[Series], stem: str) -> set[str]:
    """Columns that say what the reader takes by itself."""
    at, first = load_point(arm), series[0]
    known = arm.markers if len(arm.markers) == 1 else (ALONE,)
    places = [_place(s, stem) for s in series]
    frames = [f"{stem} {place}".strip() for place in places]
    alone = len(series) == 1
    groups = {
        ("pose",): alone and bool((first.pose == same_poses(first.q)).all()),
        ("series",): not any(places),
        ("series_frame",): [s.frame for s in series] == frames,
        ("series_target",): all(s.target == stem for s in series),
        ("marker",): first.markers == known and len(known) == 1,
        tuple(FORCE): not any(s.wrench[:, :3].any() for s in series),
        tuple(MOMENT): not any(s.wrench[:, 3:].any() for s in series),
        tuple(POINT): all((s.point == at).all() for s in series),
    }
    if set(first.markers) - set(arm.markers) and not groups["marker",]:
        raise BenchError(f"markers: expected some of {arm.name}'s {arm.markers}, got {first.markers}")
    return {name for names, silent in groups.items() if silent for name in names}


def _place(s: Series, stem: str) -> str:
    """What its name says beside that of the file."""
    return "" if s.name == stem else s.name.removeprefix(f"{stem} ")


def _unturned(s: Series, sigma: float) -> Series:
    """A series without orientations among others that have them: all were lost."""
    return replace(s, rotation=np.full((s.rows, 3, 3), np.nan), sigma_rotation=sigma)


def _table(arm: Arm, s: Series, stem: str, decimals: int | None) -> dict[str, list[str]]:
    """All columns of a series but how far it scatters, (rows * m) cells each."""
    m, count = len(s.markers), s.rows * len(s.markers)
    own: dict[str, list[str]] = {"run": list(map(str, np.repeat(s.row, m)))}
    own["pose"] = list(map(str, np.repeat(s.pose, m)))
    texts = {"series": _place(s, stem) or s.name, "series_frame": s.frame, "series_target": s.target}
    own |= {name: [as_cell(text)] * count for name, text in texts.items()}
    own["marker"] = list(map(as_cell, s.markers)) * s.rows
    blocks = [([j.column for j in arm.joints], s.q), (FORCE, s.wrench[:, :3]), (MOMENT, s.wrench[:, 3:])]
    blocks += [(POINT, s.point)]
    torques = [f"torque_{j.name}_{'N' if j.prismatic else 'Nm'}" for j in arm.joints]
    beside = ((torques, s.torque), (["time_s"], s.time))
    blocks += [(names, values.reshape(s.rows, -1)) for names, values in beside if values is not None]
    blocks += [(ROTATION, _vectors(s))] * (s.rotation is not None)
    for names, values in blocks:
        own |= _cells(names, np.repeat(values, m, axis=0), decimals)
    if s.temperature is not None:
        own |= _cells(["temperature"], np.repeat(s.temperature, m)[:, None], decimals and 2)
    lost = ~s.seen.reshape(-1, 1)
    return own | _cells(PLACE, np.where(lost, np.nan, s.position.reshape(-1, 3)), decimals)


def _vectors(s: Series) -> Array:
    """Orientations as rotation vectors, (rows, 3) [rad]; NaN where lost."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

    found = np.full((s.rows, 3), np.nan)
    if s.rotation is not None and s.turned.any():
        found[s.turned] = Rotation.from_matrix(s.rotation[s.turned]).as_rotvec()
    return found


def _covariances(s: Series) -> tuple[Array, Mask]:
    """Covariance of every position, (rows * m, 3, 3) [m^2], NaN where lost, and which are there."""
    seen = s.seen.reshape(-1)
    C = np.full((len(seen), 3, 3), np.nan)
    C[seen] = (
        s.sigma**2 * np.eye(3) if s.precision is None else np.linalg.inv(s.precision.reshape(-1, 3, 3)[seen])
    )
    return C, seen


def _scatter_columns(series: Sequence[Series]) -> list[str]:
    """Standard deviations by axis, or covariances; none where sigma says it all."""
    C = np.concatenate([own[seen] / s.sigma**2 for s in series for own, seen in [_covariances(s)]])
    if np.allclose(C, np.eye(3), rtol=0, atol=1e-12):
        return []
    least = min((LEAST[0] / s.sigma) ** 2 for s in series)
    diagonal = (C * np.eye(3) == C).all() and (np.diagonal(C, axis1=1, axis2=2) >= least).all()
    return DEVIATION if diagonal else COVARIANCE


def _scatter(s: Series, columns: list[str], decimals: int | None) -> dict[str, list[str]]:
    """How far it scatters: one number for all, and one for every reading where columns say so."""
    digits = None if decimals is None else DIGITS
    C, _ = _covariances(s)
    own = dict[str, list[str]]()
    for name, x in zip(SIGMA, (s.sigma, s.sigma_rotation), strict=True):
        if x is not None:
            own |= _cells([name], np.full((len(C), 1), x), digits, significant=True)
    values = np.column_stack([C[:, a, b] for a, b in ENTRIES.values()])
    if columns == DEVIATION:
        values = np.sqrt(np.diagonal(C, axis1=1, axis2=2))
    return own | (_cells(columns, values, digits, significant=True) if columns else {})


def _cells(
    names: Sequence[str], values: Array, digits: int | None, *, significant: bool = False
) -> dict[str, list[str]]:
    """Columns of an array as text: in full, to so many decimals, or to significant digits; NaN is blank."""

    def cell(x: float) -> str:
        if x != x:
            return ""
        if digits is None:
            return repr(x)
        return f"{x:.{digits}g}" if significant else repr(round(x, digits) + 0.0)

    return {name: list(map(cell, own)) for name, own in zip(names, values.T.tolist(), strict=True)}

"""Absolute readings read from a text file as it comes from a tracker, a spreadsheet or a robot."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import Columns, find_columns
from testbench.data.conditions import Conditions, read_conditions
from testbench.data.dataset import Ids
from testbench.data.export import runs_of
from testbench.data.mapping import read_map
from testbench.data.names import WHEN, Slot, What, series_names
from testbench.data.series import Series, select_rows, series_of
from testbench.data.series_rows import assemble
from testbench.data.series_scatter import Scatter, read_scatter
from testbench.data.sightings import Sightings, drop_other_points, read_sightings
from testbench.data.table import read_table

ALONE = "target"  #: Name of a file's only target where the arm has several.
APART = 0.02  #: Readings of one target in one pose that are farther apart are of two targets [m].
NAMES: tuple[What, ...] = ("series", "station", "series_frame", "series_target")
"""Columns that part a file into series, or name what these share."""


@dataclass(frozen=True)
class SeriesExport:
    """A file of absolute readings that was read, and how it was understood."""

    series: tuple[Series, ...]  #: One for every set-up that the file names.
    columns: Columns  #: Which column says what.
    notes: tuple[str, ...]  #: What was assumed, left out or numbered.


def read_series(
    path: str | Path,
    arm: Arm,
    mapping: str | Path | None = None,
    sigma: float | None = None,
    sigma_rotation: float | None = None,
) -> SeriesExport:
    """Read and check absolute readings of an arm; both readings of a deflection are one each.

    Args:
        path: The file; docs/formats.md says what it may hold.
        arm: The arm that was measured.
        mapping: A map of its names, TOML; None where it uses ours.
        sigma: Standard deviation of a position along an axis [m], where neither file nor map has one.
        sigma_rotation: The same of an orientation about an axis [rad].

    Returns:
        A series for every set-up that the file names, and what was understood.

    Raises:
        InputError: Names line and column, or key of the map, and what was expected.
    """
    path, mapping = Path(path), None if mapping is None else Path(mapping)
    names = read_map(mapping, arm, series_names)
    table = read_table(path, lambda name: names.find(name) is not None, names.layout)
    arm = replace(arm, markers=names.markers)
    columns = find_columns(table, names, arm)
    if any(c.slot.when for c in columns.every("reading")):
        return _pairs(columns, arm, sigma)
    if not table.rows:
        raise table.error(0, "", "expected at least one row")
    columns, dropped = drop_other_points(columns)
    notes = [f"{dropped} rows of points that the map calls no markers are left out"] * bool(dropped)
    conditions = read_conditions(columns, arm, needs_load=_says_loaded(columns))
    alone = len(arm.markers) > 1 and columns.get(Slot("marker")) is None
    alone = alone and not any(c.slot.marker for c in columns.every("reading"))
    if alone:
        arm = replace(arm, markers=(ALONE,))
        notes.append(f"no column says a marker: all readings are of one, called {ALONE!r}")
    seen = read_sightings(columns, arm, conditions.loaded)
    if alone:
        _check_alone(columns, conditions, seen)
    scatter = read_scatter(columns, sigma, sigma_rotation)
    whole, first, more = assemble(columns, arm, conditions, seen, scatter)
    notes += [*conditions.notes, *scatter.notes, *more]
    if names.frame == "base":
        notes.append("the map says base: its pose is found all the same")
    return SeriesExport(_parted(columns, whole, first, scatter), columns, tuple(notes))


def _pairs(columns: Columns, arm: Arm, sigma: float | None) -> SeriesExport:
    """Both readings of a run stand in a row."""
    export = runs_of(columns, arm, sigma)
    said, stem = columns.names.series, columns.table.path.stem
    series = series_of(export.data, stem, said.target or stem)
    if said.frame:
        series = tuple(replace(s, frame=s.frame.replace(s.name, said.frame, 1)) for s in series)
    return SeriesExport(series, columns, (*export.notes, "a run is two readings, unloaded and loaded"))


def _says_loaded(columns: Columns) -> bool:
    """Whether a row says that it is loaded."""
    state = columns.get(Slot("state"))
    words = set() if state is None else set(columns.table.texts(state.index))
    return any(columns.names.word(word, WHEN) == "after" for word in words)


def _check_alone(columns: Columns, conditions: Conditions, seen: Sightings) -> None:
    """Refuse several places in one pose under one load: they are of several targets."""
    key = np.column_stack([conditions.q, conditions.wrench])
    same = (key[1:] == key[:-1]).all(axis=1)
    apart = np.linalg.norm(np.diff(seen.position, axis=0), axis=1) > APART
    bad = np.flatnonzero(same & apart)
    if len(bad):
        problem = f"expected a column 'marker': the row above is of the same pose, {APART} m away or more"
        raise columns.table.error(bad[0] + 1, "", problem)


def _parted(columns: Columns, whole: Series, first: Ids, scatter: Scatter) -> tuple[Series, ...]:
    """The rows of a file by what its columns of set-ups say, (parts,).

    Args:
        columns: Which column says what.
        whole: All rows.
        first: Row of the table of each.
        scatter: Of every row of the table.
    """
    said, stem = columns.names.series, columns.table.path.stem
    texts = {what: _texts(columns, what, first) for what in NAMES}
    keys = list(zip(*(own or [""] * len(first) for own in texts.values()), strict=True))
    found = []
    for key in dict.fromkeys(keys):
        rows = np.array([k == key for k in keys])
        part = select_rows(whole, rows)
        own = scatter.sigma[first[rows]]
        even = scatter.covariance is None and (own == own[0]).all() and part.seen.all()
        series, station, frame, target = key
        place = " ".join(filter(None, (series, station)))
        turn = scatter.sigma_rotation[first[rows]]
        found.append(
            replace(
                part,
                name=f"{stem} {place}".strip(),
                frame=frame or f"{said.frame or stem} {place}".strip(),
                target=target or said.target or stem,
                sigma=float(np.median(own)),
                rotation=part.rotation if part.turned.any() else None,
                sigma_rotation=float(np.median(turn)) if part.turned.any() else None,
                precision=None if even else part.precision,
            )
        )
    return tuple(found)


def _texts(columns: Columns, what: What, first: Ids) -> list[str]:
    """What a column says in some rows; none where there is no such column."""
    column = columns.get(Slot(what))
    if column is None:
        return []
    texts = columns.table.texts(column.index)
    blank = next((row for row, text in enumerate(texts) if not text), None)
    if blank is not None:
        raise columns.table.error(blank, column.name, "expected a name, got ''")
    return [texts[row] for row in first]

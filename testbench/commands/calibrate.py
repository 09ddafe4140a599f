"""What `testbench calibrate` writes, says and draws: how far off an arm is, as drawn and calibrated."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from testbench.campaign.absolute import Calibrated
from testbench.campaign.arm_models import write_model
from testbench.campaign.campaign import Cell
from testbench.campaign.plan import MORE
from testbench.campaign.rows import MM
from testbench.commands.calibrate_numbers import FAR, Left, numbers, unread
from testbench.data.series import Series, select_rows
from testbench.errors import Array
from testbench.identify.absolute.state import State, forward
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.columns import columns
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, bullets, lines, say
from testbench.report.table import Row
from testbench.views.colours import GCO, MEASURED, NOMINAL, Look
from testbench.views.gains import gained
from testbench.views.markdown import Markdown
from testbench.views.scene import (
    Layer,
    Line,
    PlaceMap,
    Poses,
    RunChart,
    Scene,
    Seen,
    arrow_scale,
    of_all,
    picked,
)
from testbench.views.schema import Table

COMMAND = "testbench calibrate"  #: As manifest.json names it.
PICTURE = "calibration.png"
MOST = 3  #: Ranges that are named as the worst.
LONGEST, BENT = 0.3, 0.12  #: Length of most arrows and of most sags over the reach [1].
LOOKS = {"as drawn": Look(NOMINAL, 1, prior=True), "calibrated": Look(GCO, 0, prior=True)}
LEFT_MM = "Distance of the reading from the arm as drawn and calibrated, at the worst target (mm)"
NEGATIVE = "No arm bends against its load: the model explains the sag by other errors. Do not use it."
OF_STEPS = Markdown(
    "We try each kind of error beside those kept before it, and keep it where held-out positions get better "
    "by 5 %, a common pattern where they get no worse, joint springs always. Blocks are parts of joint "
    "space; frame and mount of a held-out series are fitted anew. RMS."
)
OF_VALUES = Markdown(
    "Errors of geometry are constants of the links' virtual joints, in each link's beam axes at its end. An "
    "interval of about 2 mm or 2 mrad is that of before any reading: no pose tells this number from another. "
    "A joint's compliance includes the bending of the link before it about its axis."
)


def write(found: Calibrated, said: Report, drawn: Seen, asked: Mapping[str, object], out: Path) -> None:
    """The model, and the folder of its report; InputError when they cannot be written.

    Args:
        found: The calibration.
        said: Its report.
        drawn: What is drawn of it.
        asked: What was asked for, as plain data, "readings" with the digests of all files by name.
        out: Folder of the results.
    """
    arm, data = found.calibration.state.vjm.arm, asked["readings"]
    assert isinstance(data, dict)
    more = partial(write_model, found.calibration, data, said.numbers["doubts"])
    leave(out, Asked(COMMAND, arm.name, asked, [arm.rigid.parent], PICTURE, more=more), said, drawn)


def report(found: Calibrated, left: Left, more: tuple[float, float] | None = None) -> Report:
    """What there is to say of a calibration.

    Args:
        found: The calibration.
        left: What both arms leave of the readings.
        more: Errors now, and after further poses, by `gain_of_more`.
    """
    f = numbers(found, left)
    f["more"] = more and Row(poses=MORE, now_mm=MM * more[0], after_mm=MM * more[1])
    f["doubts"] = [f"{name}: {text}" for name, text in _doubts(f)]
    return Report(
        scenario="calibrate",
        question=say("How far is {arm} from its drawing, and how far once calibrated?", f),
        title=say("{arm}, {total_after.n:counted position} of {k} series", f, k=len(f.series)),
        answer=lines(_answer(f)),
        worst=_worst(f),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=["series", "steps", OF_STEPS if f.steps else Markdown(), *_body(f)],
        badge=f.badge,
    )


def _tables(f: Row) -> dict[str, Table]:
    first = f.steps[:1]
    start = [Row(row, name="geometry", kept=True, after_mm=row.before_mm) for row in first]
    start = [Row(row, series_after_mm=row.series_before_mm) for row in start]
    tried = [Row(row, tried=row.name, verdict="kept" if row.kept else "dropped") for row in start + f.steps]
    kept = {row.tried: Look(GCO, 0, prior=row.kept) for row in tried}
    found = [Row(row, what=row.name) for row in (*f.compliances, *f.geometry)]
    by_series = columns("series after.n before.mean_mm after.mean_mm after.max_mm")
    spectrum = "joint rms_urad largest.order largest.amplitude_urad largest.deviation_urad significant"
    title = "What improves held-out readings, calibrated"
    return {
        "steps": Table(
            columns("tried verdict after_mm series_after_mm"), tried, title, headline="after_mm", looks=kept
        ),
        "series": Table(by_series, f.series, "Series", headline="after.mean_mm"),
        "values": Table(columns("what value half_95 unit folder"), found, "Compliances and geometry"),
        "spectrum": Table(columns(spectrum), f.spectrum, "Periodic errors of the joints"),
        "outliers": Table(
            columns("series row marker error_mm pull"), f.outliers, "Readings that hardly count"
        ),
    }


def _doubts(f: Row) -> Iterator[tuple[str, str]]:
    """What may be wrong with the calibrated arm, the gravest first."""
    if f.mounting:
        yield "Mounting", f"{f.mounting}."
    if f.pressed:
        scale = "gravity reversed, is the arm hung?" if f.weight_alone else "is a force's sign reversed?"
        yield "The compliances want to be negative", f"{scale} {NEGATIVE}"
    if f.worse:
        far = "none could be held out, so that nothing says how far others are off"
        if f.held_out_mm:
            arms = f"from the calibrated arm, {f.total_before.rms_mm:.3f} mm from the arm as drawn"
            far = f"held-out ones are {f.held_out_mm[1]:.3f} mm RMS {arms}"
        yield "Too few poses", f"{far}. Do not use it; read more."
    if f.far_geometry:
        yield "Geometry no arm has", f"{f.far_geometry}."
    if ranges := [_range(row) for row in unread(f)]:
        yield "Not read, hence extrapolated", f"{', '.join(ranges)}."
    if f.weight_alone and f.compliances:
        scale = "compliances have the scale of the masses in rigid.xml"
        words = "Masses 10 % too small make them 10 % too large; positions stay right."
        yield "Own weight is the only load", f"{scale}. {words}"
    if f.program and not f.program.conservative:
        yield "Not conservative", "a block of the compliances has a negative eigenvalue."
    if f.program and f.program.status != "solved":
        yield "Compliances", f"{f.program.method}, {f.program.status}."


def _range(row: Row) -> str:
    """A range of a joint for people."""
    return f"{row.joint} {row.low:.0f} to {row.high:.0f} {row.unit}"


def _answer(f: Row) -> Iterator[Markdown]:
    if f.held_out_mm:
        alone, every = f.held_out_mm
        yield say(
            "Held-out readings: {every:.3f} mm RMS, {alone:.3f} mm by geometry alone; {gain:less}.",
            every=every,
            alone=alone,
            gain=gained("all", "geometry", [every], [alone]),
        )
    after, before = f.total_after.mean_mm, f.total_before.mean_mm
    yield say(
        "Fitted readings are {after:.3f} mm (mean) from the calibrated arm, {before:.3f} mm from the arm as "
        "drawn; {gain:less}.",
        after=after,
        before=before,
        gain=gained("calibrated", "drawn", [after], [before]),
    )


def _worst(f: Row) -> Markdown:
    """Ranges whose error stands out."""
    limit = FAR * f.total_after.rms_mm
    far = [row for row in f.places if row.after_mm is not None and row.after_mm > limit]
    far = sorted(far, key=lambda row: -float(row.after_mm))[:MOST]
    if not far:
        return say("Worst position {max_mm:.3f} mm; no range of a joint stands out.", f.total_after)
    ranges = [f"{_range(row)} {row.after_mm:.3f} mm" for row in far]
    return say("Worst: {text}. Overall {rms_mm:.3f} mm RMS.", f.total_after, text=", ".join(ranges))


def _claims(f: Row) -> Iterator[Markdown]:
    doubts = [say("**{name}**: {text}", name=name, text=text) for name, text in _doubts(f)]
    grave = int(f.worse) + int(f.pressed) + bool(f.mounting)
    yield from doubts[:grave]
    kept, dropped = ([row.name for row in f.steps if row.kept == good] for good in (True, False))
    if f.steps:
        first = say("**Kept**: {kept:list}.", kept=kept) if kept else ""
        why = ", as they improve held-out readings by less than 5 %" if f.held_out_mm else ""
        yield lines([first, say(f"**Dropped**{why}: {{own:list}}.", own=dropped) if dropped else ""])
    yield from doubts[grave:]
    if f.pattern:
        yield say(
            "**One periodic error in {k} joints**, each turned: {text}. Where one of them was not read, the "
            "others tell.",
            k=len(f.pattern),
            text=", ".join(
                f"{row.joint} {row.turn_deg:.1f} deg{' mirrored' * row.mirrored}" for row in f.pattern
            ),
        )
    if f.more and f.more.after_mm < f.more.now_mm:
        yield say(
            "**{poses} more poses** that `testbench plan --absolute --given` chooses would take the expected "
            "error over the workspace from {now_mm:.3f} to {after_mm:.3f} mm (RMS).",
            f.more,
        )
    if f.outliers:
        yield say(
            "{less_pull_percent:.1f} % of the positions count less than sound ones (0.7 % expected); the "
            "farthest is row {row} of {series}, {error_mm:.3f} mm.",
            f | f.outliers[0],
        )


def _body(f: Row) -> list[Markdown | str]:
    """What was found, what stays open, how far readings scatter, how they were understood."""
    n, program = f.noise, f.program
    solved = say("{method}: {status}.", program) if program else Markdown("The arm is rigid.")
    signs = "; none is let below 0" if program and program.constrained else ""
    least = min((row.smallest for row in f.blocks), default=None)
    scatter = say(
        "The readings scatter by {sigma_um:.0f} um along an axis, the model leaves {open_position_um:.0f} um "
        "open beside it{turns}. They scatter {position_factor:.2f} times as much as these say.",
        n,
        turns=f", of orientations {n.open_rotation_urad:.0f} urad" if n.open_rotation_urad else "",
    )
    blocks = say(f"Smallest eigenvalue of a block: {{least:.3g}} SI{signs}.", least=least) if program else ""
    heads = ("## What stays open", "## Scatter", "## How the readings were understood")
    open_ = bullets(f.left_open) or Markdown("Nothing: every error that was kept is seen.")
    notes = bullets(f.notes) or Markdown("As they were given.")
    return [
        *("values", lines([OF_VALUES, solved, blocks]), Markdown(heads[0]), open_, "spectrum"),
        *(Markdown(heads[1]), scatter, "outliers", Markdown(heads[2]), notes),
    ]


def seen(cell: Cell, found: Calibrated, left: Left) -> Seen:
    """Readings on the arm, how far and where it was off, as drawn and calibrated."""
    rows, total = _drawn(found, left)
    sizes = [MM * np.nanmax(np.linalg.norm(x, axis=2), axis=1) for x in (rows.before, rows.after)]
    marks = [Line(name, look, mm) for (name, look), mm in zip(LOOKS.items(), sizes, strict=True)]
    scene = _scene(cell, rows, sizes)
    note, names = of_all(len(rows.q), total, "poses"), [str(k) for k in rows.row]
    return Seen(
        scene=scene,
        map=PlaceMap(LEFT_MM, 0, rows.tool, marks),
        runs=[RunChart("Pose by pose (mm)", 0, "row of the file", names, marks, note=note)],
    )


def _drawn(found: Calibrated, left: Left) -> tuple[Row, int]:
    """The farthest rows of all series and others evenly, and how many there are."""
    series, state, first = found.series, found.calibration.state, 0
    m = max(len(one.markers) for one in series)
    size = [
        np.where(one.seen, np.linalg.norm(x, axis=2), -1.0).max(axis=1)
        for one, x in zip(series, left[1], strict=True)
    ]
    known = np.flatnonzero(np.concatenate(size) >= 0)
    some, parts = picked(np.concatenate(size), known), []
    for one, *both in zip(series, *left, strict=True):
        at = some[(first <= some) & (some < first + one.rows)] - first
        parts.append(_shown(state, select_rows(one, at), [x[at] for x in both], m))
        first += one.rows
    return Row({key: np.concatenate([part[key] for part in parts]) for key in parts[0]}), len(known)


def _shown(state: State, series: Series, left: Sequence[Array], m: int) -> Row:
    """Rows of a series; of a target that was lost, or that another series has more, NaN.

    Joints (rows, n) [rad, m]; tool (rows, 3) [m] and sag (rows, n_theta) by the calibrated arm; targets as
    read, and reading minus arm as drawn and calibrated, (rows, m, 3) [m].
    """
    told = forward(state, series)
    read = told.where.points(state.mount(series).points) + left[1]
    before, after, at = (np.full((series.rows, m, 3), np.nan) for _ in range(3))
    for values, own in ((before, left[0]), (after, left[1]), (at, read)):
        values[:, : len(series.markers)] = np.where(series.seen[..., None], own, np.nan)
    sag = (state.C_theta @ told.u).T
    names = np.full(series.rows, series.name, dtype=object)
    return Row(
        **{"name": names, "row": series.row, "q": series.q, "tool": told.where.position, "sag": sag},
        **{"read": at, "before": before, "after": after},
    )


def _scene(cell: Cell, rows: Row, sizes: Sequence[Array]) -> Scene:
    """The arm in every row, and from where it should have its targets to where they were read, enlarged."""
    reach = cell.vjm.reach
    A = arrow_scale(rows.before, LONGEST * reach)
    straight, soft = rigid_frames(cell.room, rows.q), bool(rows.sag.any())
    moved = elastic_frames(cell.plant, rows.q, rows.sag).positions - straight.positions
    M = arrow_scale(moved[:, -1], BENT * reach)
    errors = zip(LOOKS.items(), (rows.before, rows.after), strict=True)
    group = Poses(
        name="Readings",
        names=[f"{name}, row {row}" for name, row in zip(rows.name, rows.row, strict=True)],
        words=[
            f"{b:.3f} mm as drawn, {a:.3f} mm calibrated. {cell.arm.words(q)}."
            for b, a, q in zip(*sizes, rows.q, strict=True)
        ],
        rigid=straight,
        bent=elastic_frames(cell.plant, rows.q, M * rows.sag) if soft else None,
        layers=[
            *(
                Layer(f"error {name}", look.colour, "arrows", rows.read - A * error, rows.read)
                for (name, look), error in errors
            ),
            Layer("target as read", MEASURED, "dots", rows.read),
        ],
        first=int(np.argmax(sizes[1])),
    )
    title = f"Arrows from where the arm should have its target to the reading x {A:g}."
    return Scene(cell, f"{title} Sag of the calibrated arm x {M:g}." if soft else title, [group])

"""Fits to a user's runs: their badge and warnings, and pictures of the arm, residuals and half widths."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from testbench.data.dataset import select_rows
from testbench.errors import Array, Ids
from testbench.model.laws import set_load_history, vjm_for_structure
from testbench.model.vjm import add_law_deflections, evaluate_chain, generalised_load
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.badge import MIN_PAIRS, Badge, badge_against_all, incumbents, ratios
from testbench.report.colours import MEASURED, NOMINAL, look
from testbench.report.markdown import Markdown, capital, ended
from testbench.report.report import say
from testbench.report.scene import (
    Layer,
    ModelLine,
    PageContent,
    PlaceMap,
    PoseGroup,
    RunChart,
    Scene,
    arrow_scale,
    at_one_target,
    largest_and_even,
    loads,
    of_all,
    on_tool,
    read_along,
    workspace,
)
from testbench.runs.rows import Row
from testbench.workflows.cell import Cell
from testbench.workflows.error_places import ErrorPlaces
from testbench.workflows.fit_numbers import COUNTS, compared_models, held_out, largest_vector
from testbench.workflows.fits import IdentifyResult
from testbench.workflows.model_names import in_words
from testbench.workflows.rows import MM

MOVED, LEFT = 0.12, 0.2  #: Length of most arrows of deflections and of errors over the reach [1].
LEFT_MM = "Largest residual of each run (mm)"
NOWHERE = "no bound"
NEXT = "Measure next"  #: What is written where the chosen model is least sure.


def seen(cell: Cell, identified: IdentifyResult, f: Row, left: Mapping[str, Array]) -> PageContent:
    """Collect what page, picture and recording draw.

    Args:
        cell: The arm as its folder has it.
        identified: The fits.
        f: Their numbers, `fit_numbers.numbers`, with the badge of the report.
        left: Residuals by model, (runs, m, 3) [m].

    Returns:
        The content.
    """
    data = identified.runs.every
    names = compared_models(f.models, f.recommended)
    rival = [f.badge.rival] if f.badge and f.badge.rival not in names else []
    names = [*rival, *names]
    some = largest_and_even(largest_vector(left[names[-1]]), np.flatnonzero(data.is_measured.any(axis=1)))
    groups: list[PoseGroup] = []
    title, charts = "", []
    if len(some):
        runs, title = _runs(cell, identified, f, {name: left[name] for name in names}, some)
        groups.append(runs)
        lines = [_line(f, name, MM * largest_vector(left[name])[some]) for name in names]
        labels, note = (
            [str(data.run_id[k]) for k in some],
            of_all(len(some), identified.runs.every.n_runs, "runs"),
        )
        charts = [RunChart(LEFT_MM, 0, "run", labels, lines, f.noise_p95_mm, note)]
    if f.map is not None:
        groups.append(_places(cell, f.map.errors, f.recommended))
    return PageContent(
        scene=Scene(cell, title, groups) if groups else None,
        map=None if f.map is None else _map(f, len(groups) - 1),
        runs=charts,
    )


def _line(f: Row, name: str, values: Array) -> ModelLine:
    own = next(model for model in f.models if model.name == name)
    return ModelLine(name, look(own.structure, own.constraint, own.prior), values)


def _runs(
    cell: Cell, identified: IdentifyResult, f: Row, left: Mapping[str, Array], some: Ids
) -> tuple[PoseGroup, str]:
    """Bend the arm by the model to take, with targets as read and modelled; say what is magnified."""
    data = identified.runs.every
    reach = cell.vjm.reach
    taken = f.recommended
    hidden = np.where(data.is_measured[some][..., None], 0.0, np.nan)
    moved, off = data.deflection[some] + hidden, {name: own[some] + hidden for name, own in left.items()}
    M, A = arrow_scale(moved, MOVED * reach), arrow_scale(off[taken], LEFT * reach)
    before = data.before[some] + hidden
    at = before + M * moved
    start, one = at_one_target(at, off, taken)
    vjm = vjm_for_structure(cell.vjm, identified.taken.structure)
    where = evaluate_chain(set_load_history(vjm, data.unloaded_after_load, some), data.q[some])
    load = generalised_load(where, data.wrench[some], data.point[some])
    theta = add_law_deflections(vjm, (identified.taken.C_theta @ load).T)  # Eq. (6)
    rows = [f.residuals[k] for k in some]
    bent = elastic_frames(cell.plant, data.q[some], M * theta)
    looks = {name: _line(f, name, at).look for name in one}
    errors = [
        Layer(f"error of {in_words(name)}", looks[name].colour, looks[name].stroke, start, start - A * own)
        for name, own in one.items()
    ]
    poses = PoseGroup(
        name="Runs, against their readings",
        names=[f"Run {row.which_run}" for row in rows],
        words=[
            _said(row, list(left), cell.arm.pose_text(data.q[k])) for row, k in zip(rows, some, strict=True)
        ],
        rigid=rigid_frames(cell.room, data.q[some]),
        bent=bent,
        layers=[
            *loads(on_tool(cell, bent, data.point[some]), data.wrench[some, :3], reach),
            *read_along(select_rows(data, some), where.tool_position, reach),
            Layer("targets read unloaded", NOMINAL, "dots", before),
            Layer("read under load", MEASURED, "dots", at),
            Layer("deflection as read", MEASURED, "lines", before, at),
            *errors,
        ],
        first=int(largest_vector(left[taken])[some].argmax()),
    )
    arrows = "arrows from reading to model, where the chosen model errs most"
    return poses, f"Deflections x {M:g}; {arrows}, x {A:g}."


def _said(row: Row, names: list[str], joints: str) -> str:
    left = ", ".join(f"{in_words(name)} {row.residual_mm[name]:.3f} mm" for name in names)
    return (
        f"Pose {row.pose}, deflection {row.moved_mm:.3f} mm. Residual at the worst target: {left}. "
        f"Joints at {joints}."
    )


def _places(cell: Cell, errors: ErrorPlaces, taken: str) -> PoseGroup:
    """Show the arm all over the workspace."""
    half = errors.error_mm[taken]
    sizes = zip(errors.deflection_mm, half, errors.joints, strict=True)
    words = [
        f"The tool moves {moved:.3f} mm, {_bound(mm)} (95 %). Joints at {joints}."
        for moved, mm, joints in sizes
    ]
    tool = Layer("tool", MEASURED, "dots", errors.position_m[:, None])
    first = int(np.nan_to_num(half).argmax())
    words[first] = f"{NEXT}: here the model is least sure. {words[first]}"
    poses = workspace(cell, errors.q, words, [tool], first)
    return replace(poses, name="Workspace, under the largest load", fixed=True)


def _bound(mm: float) -> str:
    return f"± {mm:.3f} mm" if np.isfinite(mm) else NOWHERE


def _map(f: Row, group: int) -> PlaceMap:
    """Map each model; joints alone have no map: what they leave out is in no half width."""
    errors = f.map.errors
    half = {name: errors.error_mm[name] for name in errors.compared}
    return PlaceMap(
        f"95 % half width of the tool's deflection under the largest load (mm); {COUNTS}",
        group,
        errors.position_m,
        [_line(f, name, mm) for name, mm in half.items()],
        heading="Uncertainty at other poses",
        without="" if all(np.isfinite(mm).all() for mm in half.values()) else NOWHERE,
        worst_is="next: ±",
    )


def badge(identified: IdentifyResult, left: Mapping[str, Array]) -> Badge | None:
    """Compare the recommended model with its strongest rival, by what was held out.

    Args:
        identified: The fits.
        left: Residuals by model.

    Returns:
        The badge; None without a rival.
    """
    rms, each = held_out(identified, left, MIN_PAIRS)
    taken, fits = identified.fits.recommended, identified.fits
    rivals = [name for name in incumbents(fits.models, taken) if name in rms]
    why = "first check the runs, see the warning" if any(x.name != "prior" for x in fits.doubts) else ""
    own = badge_against_all(taken, {name: (rms[taken], rms[name], None) for name in rivals}, each, why)
    if own and own.interval is None and own.factor and own.winner != taken:  # all readings chose it, not few
        return Badge(**vars(own) | {"winner": taken, "rival": own.winner, "factor": 1 / own.factor})
    return own


def ratios_to_chosen(identified: IdentifyResult, left: Mapping[str, Array]) -> list[Row]:
    """Compare the held-out errors of all models with those of the model to take.

    Args:
        identified: The fits.
        left: Residuals by model.

    Returns:
        A row per model; none where too few runs were held out.
    """
    rms, each = held_out(identified, left, MIN_PAIRS)
    taken = identified.fits.recommended
    if len(rms.get(taken, ())) < MIN_PAIRS:
        return []
    return ratios(taken, {name: (rms[taken], own, None) for name, own in rms.items() if name != taken}, each)


def warnings(f: Row, taken: Row) -> Iterator[Markdown]:
    """List what may be wrong with readings and fits, then notes; `docs/identify.md` says what each means.

    Args:
        f: Numbers of the fits.
        taken: The model to take, one of them.

    Yields:
        The warnings.
    """
    for doubt in sorted(f.doubts, key=lambda doubt: doubt["name"] == "prior"):
        yield say("Warning: {text}", text=ended(doubt["sentence"]))
    told = [text for text in f.notes if text.startswith("warning: ")]
    yield from (say("{text}", text=ended(capital(text))) for text in told)
    if taken.get("rejected"):
        yield say("Outliers left out of {name}: {rejected}.", taken)
    yield from (say("Your estimator '{name}' {text}", m, text=ended(m.status)) for m in f.failed)
    ours = (m for m in f.models if m.constraint != "own")  # nobody certifies an estimator of the user's own
    yield from (say("Not certified: {name} ({status}).", m) for m in ours if m.status != "solved")
    if taken.check is None and taken.f_m_held_out is None:
        others = "a second pose would allow it" if f.poses == 1 else "`--check-pose N` holds one out"
        yield Markdown(f"No pose was held out; {others}.")
    yield from _of_intervals(f, taken)
    if taken.aggregated:
        yield say(
            "The compliance of these joints is part of the link before them: {aggregated:list}.",
            taken,
        )
    further = [text for text in taken.advice if text not in f.why]
    for text in (f"why this model: {f.why}", *(note for note in f.notes if note not in told), *further):
        yield say("{text}", text=ended(capital(text)))


def _of_intervals(f: Row, taken: Row) -> Iterator[Markdown]:
    """List what no reading checks, and what intervals lack."""
    for how in (how for how in ("stiffer", "softer") if f.unchecked[how]):
        yield say(
            f"These could be ten times {how} without changing the readings: {{{how}:list}}.", f.unchecked
        )
    if held := [m.name for m in f.models if m.intervals and m.intervals.on_boundary]:
        yield say(
            "Intervals are approximate because the estimate is on the boundary of the cone: {held:list}.",
            held=held,
        )
    if taken.intervals and not taken.prior:
        yield Markdown("Without a prior, intervals contain the noise only.")
    if f.map is None and taken.intervals:
        yield say("There is no map of the workspace: {no_map}.", f)
    if f.map is not None and f.map.missing:
        yield say("No static equilibrium in some poses of the workspace: {missing:list}.", f.map)

"""What `testbench identify` writes and says of fits: which model to take, how good, how sure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from testbench import files
from testbench.campaign.arm_models import write_stiffness
from testbench.campaign.campaign import Cell
from testbench.campaign.fits import Identified
from testbench.campaign.model_folder import FITS
from testbench.campaign.models import JOINTS, is_least_squares
from testbench.commands.identify_drawn import seen
from testbench.commands.identify_rows import COUNTS, left_by, numbers
from testbench.report.columns import columns
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, find, plain
from testbench.views.gains import Gain, gained
from testbench.views.markdown import Markdown, capital, ended
from testbench.views.schema import Table

COMMAND = "testbench identify"  #: As manifest.json names it.
PICTURE = "identify.png"
MOST = 30  #: Runs that are listed, the worst.
LEFT = "Worst in run {which_run}: {taken_mm:.3f} mm are left of {moved_mm:.3f} mm."
MODELS = (
    "name parameters rank conservative check.rms_mm f_m_held_out identification.rms_mm f_m "
    "f_m_floor intervals.half_width_mm elsewhere.half_width_mm elsewhere.apart_mm"
)
PAGE = 3  #: Of these columns, the last ones, that a terminal has no room for.
LAWS, STRUT = "part stiffer_percent backlash_urad friction_urad", "strut_percent"
ABOUT_LAWS = Markdown(
    "Sizes of laws beside the compliances. *Stiffer*: when the spring is turned by a milliradian, over no "
    "load. *Backlash*, *friction*: half widths; of a slide in um and millimetres. *Compensator takes off*: "
    "share of the joint's turn under a load, where the compensator's lever is longest."
)
READING = {
    "f_m_held_out": "*F_M held out*: the mean on poses and load levels held out in turn.",
    "intervals.half_width_mm": f"*+- (95 %)*: median half width of the interval of a deflection; {COUNTS}.",
    "elsewhere.apart_mm": "*From the model to take*: of the loaded tool, median.",
}
"""What a column of the models is."""


def tell(cells: tuple[Cell, Cell], found: Identified, flags: Mapping[str, object], out: Path) -> Report:
    """Write the model, all fits, report, pictures, recording, page and manifest.json; return what to say.

    Args:
        cells: The arm as its folder has it, and with the targets that were found.
        found: Its fits.
        flags: What was asked for, as plain data.
        out: Folder of the results.

    Raises:
        InputError: When they cannot be written.
    """
    (filed, cell), data = cells, flags["dataset"]
    assert isinstance(data, dict)
    left = left_by(cell, found)
    f = numbers(filed, cell, found, left, widths=bool(flags["intervals"]))
    said = report(f)

    def more(folder: Path) -> None:
        files.write_json(plain(found.fits), folder / FITS)
        write_stiffness(cell, found, found.runs, data, folder)

    arm = [cell.arm.rigid.parent]
    title = f"{f.arm} under {_load(f.map)}" if f.map else ""
    asked = Asked(COMMAND, f.arm, flags, arm, PICTURE, more=more, map=title)
    leave(out, asked, said, seen(filed, found, f, left))
    return said


def report(f: Row) -> Report:
    """What there is to say of fits."""
    taken, worst = find(f.models, name=f.recommended), max(f.residuals, key=lambda row: row.taken_mm)
    runs = sorted(f.residuals, key=lambda row: -row.taken_mm)[:MOST]
    models = _models(f, MODELS.split())
    laws = f"{LAWS} {STRUT}" if any(row.get(STRUT) is not None for row in f.laws) else LAWS
    return Report(
        scenario="identify",
        question=say("Which stiffness model of {arm} to take, and how sure is it?", f),
        title=say(
            "{arm}: {runs:counted run} in {poses:counted pose} of {dataset} fitted; errors are distances at "
            "the markers, against readings",
            f,
        ),
        answer=lines(_answer(f, taken)),
        worst=lines([_least_sure(f), say(LEFT, worst)]),
        claims=list(_claims(f, taken)),
        numbers=f,
        tables={
            "models": models,
            "runs": Table(columns("which_run pose moved_mm taken_mm"), runs, "What is left in each run"),
            **({"laws": Table(columns(laws), f.laws, "Joints beyond a spring")} if f.laws else {}),
            "told": Table(
                columns("part parameters told_percent decided_by_prior"), f.seen.blocks, "What the runs tell"
            ),
        },
        body=[
            "models",
            Markdown(" ".join(READING[c.key] for c in models.columns if c.key in READING)),
            *(["laws", ABOUT_LAWS] if f.laws else []),
            "runs",
            _about_runs(f),
            "told",
            _about_told(f),
            *_elsewhere(f),
        ],
        badge=f.get("badge"),
    )


def _models(f: Row, keys: Sequence[str]) -> Table:
    """Every model on a line; what was not asked for has no column."""
    every = columns(" ".join(keys), paper=False)
    known = tuple(c for c in every if any(c.value(m) is not None for m in f.models))
    if f.failed:
        known = tuple(replace(c, none="not fitted") if c.key == "check.rms_mm" else c for c in known)
    judged = ("check.rms_mm", "f_m_held_out", "identification.rms_mm")
    headline = next(key for key in judged if any(c.key == key for c in known))
    return Table(known, [*f.models, *f.failed], "Models", f.recommended, headline)


def printed(said: Report) -> Table:
    """The models for a terminal of 80 columns."""
    return _models(Row(said.numbers), MODELS.split()[:-PAGE])


def _beside(f: Row, taken: Row, name: str) -> Gain | None:
    """The model to take beside another one in the runs held out; None where one was not judged there."""
    errors = {m.name: m.check.rms_mm for m in f.models if m.check is not None}
    if name == taken.name or not {name, taken.name} <= errors.keys():
        return None
    return gained(taken.name, name, [errors[taken.name]], [errors[name]])


def _answer(f: Row, taken: Row) -> Iterator[Markdown]:
    """What to take, beside least squares and joints alone in the runs held out."""
    wrong = any(doubt["name"] != "prior" for doubt in f.doubts)
    plain = [m for m in f.models if m.check and is_least_squares(m.structure, m.constraint, prior=m.prior)]
    best = min(plain, key=lambda m: m.check.rms_mm, default=None)
    ls = _beside(f, taken, best.name) if best and not wrong else None
    joints = _beside(f, taken, JOINTS)
    beaten = f.get("badge") is not None and f.badge.winner != taken.name
    first = "Chosen, though beaten where runs are held out, is" if beaten else "Take"
    if wrong:
        first = "First look at the runs, see the doubt below; if they are right, take"
    checked = ": {check.rms_mm:.3f} mm RMS in the runs held out" if taken.check else ""
    beside = ", least squares {ls.theirs_mm:.3f} mm; {ls:less}" if ls else ""
    yield say(f"{first} {{name}}{checked}{beside}.", taken, ls=ls)
    half = bool(taken.intervals) and taken.intervals.half_width_mm is not None
    sure = "to +- {intervals.half_width_mm:.3f} mm (95 %, median)"
    if joints:
        sure = f"; a deflection along an axis is predicted {sure}" if half else ""
        yield say(f"Joint stiffness only {{it.theirs_mm:.3f}} mm, {{it:more}}{sure}.", taken, it=joints)
    else:
        sure = f" and gives a deflection in these runs {sure} along an axis" if half else ""
        if half and taken.elsewhere and taken.elsewhere.half_width_mm is not None:
            sure += ", over the workspace +- {elsewhere.half_width_mm:.3f} mm"
        yield say(f"It fits the readings to {{identification.rms_mm:.3f}} mm RMS{sure}.", taken)


def _least_sure(f: Row) -> Markdown:
    """Where over the workspace the model to take is least sure, and others there."""
    if f.map is None:
        return Markdown()
    errors = f.map.errors
    if f.recommended not in errors.worst:
        return Markdown("Nowhere in the workspace is there a bound.")
    at = errors.worst[f.recommended]
    there = {name: errors.error_mm[name][at.place] for name in errors.compared[::-1]}
    sizes = [f"{name} no bound" if mm is None else f"{name} +- {mm:.3f} mm" for name, mm in there.items()]
    return say(
        "Least sure at {position_m:place}: {sizes}. Joints {joints}.", vars(at), sizes=", ".join(sizes)
    )


def _claims(f: Row, taken: Row) -> Iterator[Markdown]:
    wrong = sorted(f.doubts, key=lambda doubt: doubt["name"] == "prior")
    if taken.get("rejected"):
        yield say(
            "{name} is fitted without {rejected:counted outlier}; errors here count all readings.", taken
        )
    yield from (say("Doubt: {text}", text=ended(doubt["sentence"])) for doubt in wrong)
    yield say("Why {recommended}: {why}", f, why=ended(f.why))
    yield from (say("Your estimator {name} {text}", m, text=ended(m.status)) for m in f.failed)
    yield from (
        say("Not certified: {name}{why}.", m, why="" if m.status == "not certified" else f" ({m.status})")
        for m in f.models
        if m.status != "solved"
    )
    if taken.check is None and taken.f_m_held_out is None:
        yield Markdown(
            "No pose was held out (--check-pose): a good fit alone does not show how well a model predicts."
        )
    yield from _of_intervals(f, taken)
    yield from (say("{text}", text=ended(capital(text))) for text in f.notes)
    if f.scale is not None:
        yield say("The deflections are {scale:.2f} times those that the arm's folder predicts.", f)
    if taken.aggregated:
        yield say(
            "Aggregated in {name}: the compliance of {aggregated:list} counts to the link before it.",
            taken,
        )
    yield from (say("{text}", text=ended(capital(text))) for text in taken.advice)


def _of_intervals(f: Row, taken: Row) -> Iterator[Markdown]:
    """What no reading checks, and what the intervals do not count."""
    hidden = "These readings could not reveal a part ten times {how} than in the folder: {x:list}."
    if stiffer := f.unchecked.stiffer:
        counts = " The intervals assume that there is none." if taken.intervals and taken.learnt else ""
        yield say(hidden + counts, how="stiffer", x=stiffer)
    if softer := f.unchecked.softer:
        yield say(hidden, how="softer", x=softer)
    if held := [m.name for m in f.models if m.intervals and m.intervals.on_boundary]:
        yield say(
            "The intervals of {x:list} are not exact: the semi-definite condition holds the estimate.",
            x=held,
        )
    if taken.intervals and not taken.prior:
        yield Markdown(
            "The intervals count noise alone: without a prior nobody knows what the model leaves out."
        )


def _about_runs(f: Row) -> Markdown:
    more = f" The worst {MOST} of {{n}} runs; all are in report.json." * (len(f.residuals) > MOST)
    return say(
        "Of {recommended}, at the target where it is worst. Noise alone stays below {noise_p95_mm:.3f} mm in "
        f"95 % of runs.{more}",
        f,
        n=len(f.residuals),
    )


def _about_told(f: Row) -> Markdown:
    return say(
        "Of the {unknowns} unknowns of {structure} the runs see {seen} directions. Shares are beside a prior "
        "known to {prior_uncertainty_percent:.0f} %. `testbench identifiability` names what is not seen, and "
        "what would help.",
        f.seen,
    )


def _load(places: Row) -> str:
    """The load in words."""
    return f"{places.force_N:.0f} N" + (f" and {places.moment_Nm:.0f} N m" if places.moment_Nm else "")


def _elsewhere(f: Row) -> list[Markdown]:
    """How sure the tool's deflection is all over the workspace."""
    heading = Markdown("## How sure it is elsewhere")
    if f.map is None:
        return [heading, say("No map: {no_map}.", f)]
    own, worst = f.map, f.map.errors.worst.get(f.recommended)
    spread = say(
        "Under {load}, the largest load that was fitted, in {places} poses over the workspace. "
        "Half widths of the 95 % interval of the tool's deflection, along its widest axis: {least_mm:.3f} mm "
        "at least, {median_mm:.3f} mm in the median, below {p95_mm:.3f} mm in 95 % of them.",
        own,
        load=_load(own),
    )
    unbounded = say(
        "**No bound in {without_bound} of {places} poses**: there the deflection depends on what no reading "
        "shows. A prior gives one, or other poses and loads do.",
        own,
    )
    soft = say("{missing:list}: so soft that the load finds no equilibrium.", own)
    parts = [spread if worst else "", unbounded if own.without_bound else "", soft if own.missing else ""]
    return [heading, lines(parts)]

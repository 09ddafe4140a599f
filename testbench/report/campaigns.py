"""What studies that judge models by campaigns share: the best of a method, pairs, the map, the recording."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from testbench.bench.baselines import JOINTS, distinct
from testbench.bench.campaign import Campaign, Cell
from testbench.bench.default import DEFAULT
from testbench.bench.error_places import ErrorPlaces, Places, error_places
from testbench.bench.judged import Result
from testbench.bench.truths import CALLED, FAMILY
from testbench.data.csvfile import write_csv
from testbench.identify import Constraint
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import TRIAL, Row, Trials, aligned, matched, merged, nested, paired
from testbench.trials.spread import SAME, Number, Spread, middle, wins
from testbench.views.gains import beside
from testbench.views.markdown import Markdown
from testbench.views.page.calibration import calibration_seen
from testbench.views.page.page import Seen
from testbench.views.schema import Best, Column, Table, best_of, pivot

TRUE = "workspace.rms_mm"  #: What models are judged by.
ERROR = "rms_um"  #: What models are judged by in every case of a factor, such as noise or a disturbance.
RMS = replace(columns(ERROR)[0], form=".0f")
BY_CONE = (("MGCO56", "MLS56"), ("MGCO56 + prior", "MLS56 + prior"))
DUELS = (*BY_CONE, ("MGCO56", JOINTS), ("MGCO56 + prior", JOINTS), (DEFAULT, JOINTS))
"""What the cone does without a prior and with it, then both and the default against the incumbent."""
METHODS: Mapping[Constraint, str] = {
    "none": "least squares",
    "psd": "GCO",
    "free": "least squares, conservative of equal fit",
}
ARMS = Markdown(
    "True arms: links of tubes, as in the model; links 10, 20 and 40 % off any tube; cast links; unequal "
    "joints. The model and the prior stay those of the arm's folder."
)


def best(models: Sequence[Row], constraint: Constraint, *, prior: bool) -> str:
    """The best of one method over the workspace, empty for none; joint stiffness alone is no method.

    Of those alike the one of most unknowns: MLS32 is MLS56 without what no reading tells, to the digits.
    """
    own = {
        m.name: m for m in models if (m.constraint, m.prior) == (constraint, prior) and m.structure != JOINTS
    }
    alike = best_of({name: m.workspace.rms_mm for name, m in own.items()}).names
    return max(alike, key=lambda name: own[name].parameters, default="")


def recommended(models: Sequence[Row]) -> str:
    """The conservative model of least error over the workspace; of those alike the one of fewest unknowns.

    Of those again one that is conservative by construction. Empty where none is conservative.
    """
    held = {m.name: m for m in models if m.conservative is True}
    alike = [held[name] for name in best_of({n: m.workspace.rms_mm for n, m in held.items()}).names]
    return min(alike, key=lambda m: (m.parameters, m.constraint != "psd")).name if alike else ""


def pairs(trials: Trials, asked: Mapping[str, tuple[str, str]], value: str = TRUE, scale: float = 1.0) -> Row:
    """Two models in the same trials, by what the comparison is called; those that are there.

    Each is what `Gain` holds, and `won`, the share of trials in which ours errs less. For value and scale see
    `paired`.
    """
    found = Row()
    for name, (ours, theirs) in asked.items():
        if gain := paired(trials, ours, theirs, value, scale):
            a, b = aligned(trials, (ours, theirs), value).T
            found[name] = Row(vars(gain), alike=gain.alike, won=wins(a, b) / len(a))
    return found


def at_case(trials: Trials, models: Sequence[Row]) -> Row:
    """Who is best in one case, with any prior and with none; what the default gains; all these by true arm.

    Args:
        trials: Of the case.
        models: The same merged, a row a model.
    """
    errors = {m.name: m.rms_um for m in models}
    without = [m for m in models if not m.prior and m.name != JOINTS]
    best, plain = (best_of({m.name: m.rms_um for m in own}).names for own in (models, without))
    [rival, *_] = best_of({m.name: m.rms_um for m in without if m.constraint == "none"}).names
    rivals = {"least_squares": (DEFAULT, rival), "joints": (DEFAULT, JOINTS)}
    return Row(
        leaders=Row(
            best=best,
            best_um=errors[best[0]],
            default_um=errors[DEFAULT],
            plain=plain,
            plain_um=errors[plain[0]],
            joints_um=errors[JOINTS],
        ),
        gains=pairs(trials, rivals, ERROR, 1e-3),
        by_arm=by_arm(trials.where(name={*best, DEFAULT, *plain, JOINTS}), ERROR),
    )


def head(asked: str, seeds: Sequence[int], trials: Trials) -> Row:
    """What report.json says first of the family of true arms, or of the one that was asked for."""
    arms = {arm: len(own.values(TRIAL)) for (arm,), own in trials.groups("true_arm")}
    seed = list(seeds) if len(seeds) > 1 else seeds[0]
    return Row(seed=seed, noise=True, true_arm=asked, true_arms=arms)


def named(names: Sequence[str]) -> str:
    """Names in a sentence; of several that they are alike."""
    return Best(tuple(names), 0.0).words


def beside_rivals(models: Sequence[Row], gains: Row) -> list[Markdown]:
    """Errors of the default, of least squares and of joints alone in one case, a sentence each rival."""
    own = {m.name: m for m in models}
    least_squares, joints = gains.least_squares, gains.joints
    return [
        say(
            "{name} {rms_um:~.0f} um, least squares {other.rms_um:~.0f} um; {it:less}.",
            own[least_squares.ours],
            other=own[least_squares.theirs],
            it=least_squares,
        ),
        say("Joints alone {rms_um:~.0f} um, {it:more trial}.", own[joints.theirs], it=joints),
    ]


def gains_told(gains: Row) -> str:
    """The same for the title of a figure."""
    return beside({"least squares": gains.least_squares, "joints alone": gains.joints}, "um")


def duels(trials: Trials, asked: Sequence[tuple[str, str]], *by: str, of: str = "name") -> list[Row]:
    """Two on the same readings, by case: ratio of errors, shares of trials in which ours is less, or alike.

    Args:
        trials: Of all.
        asked: Ours and theirs.
        by: Columns in which the rows of a case are alike.
        of: The column of ours and theirs.
    """
    found = []
    for ours, theirs in asked:
        own = trials.where(**{of: ours})
        a, b = own[ERROR], matched(own, trials.where(**{of: theirs}), ERROR, (*by, TRIAL))
        won, lost = a < (1 - SAME) * b, b < (1 - SAME) * a
        kept = own.keep(*by).add(ratio=a / b, won=won, tied=~won & ~lost)
        for _, case in kept.groups(*by):
            [row] = merged(case)
            pair = Row({**row, "ours": ours, "theirs": theirs, "trials": len(case)})
            found.append(shares(pair, "won", "tied"))
    return found


def shares(row: Row, *names: str) -> Row:
    """Truth values as shares of trials, also where all trials agree."""
    return Row(row, **{name: float(row[name]) for name in names})


def by_cone(where: str, found: Sequence[Row]) -> Markdown:
    """What the cone does by itself in one case, without a prior and with it.

    Args:
        where: The case.
        found: Its duels.
    """
    plain, filled = (next(d for d in found if (d.ours, d.theirs) == pair) for pair in BY_CONE)
    alike = ", and they err alike in {tied:yes}" if filled.tied else ""
    return say(
        "The cone by itself{where}: {plain.ours} beats {plain.theirs} in {plain.won:yes} of {trials} trials. "
        f"With the prior it does in {{won:yes}}{alike}.",
        filled,
        plain=plain,
        where=where,
    )


def existing(rows: Sequence[Row]) -> list[Row]:
    """Models by case, without a completion that exists in no trial with noise: least squares once more."""
    there = {row.name for row in rows if row.sigma_um > 0 and row.conservative is not False}
    return [row for row in rows if row.constraint != "free" or row.name in there]


def contract(models: Sequence[Row], where: str, judged: str) -> list[Row]:
    """Rows of report.json's `models` of one case, judged by the check set or over the workspace."""
    none = {"check": None, "workspace": None, "paper": None}
    return [
        Row(
            {key: m[key] for key in ("constraint", "prior", "conservative", "solved")} | none,
            name=f"{m.name}, {where}",
            method=METHODS[m.constraint],
            **{judged: Row(rms_mm=_mm(m.rms_um), p95_mm=_mm(m.p95_um))},
        )
        for m in models
    ]


def _mm(um: Number) -> Number:
    return um.scaled(1e-3) if isinstance(um, Spread) else middle(um) / 1e3


def arms_told(f: Row) -> Markdown:
    """True arms in words, with their trials."""
    if f.true_arm != FAMILY:
        return say("True arm: {arm}.", arm=CALLED[f.true_arm])
    return say(
        "True arms in turn: {arms}.", arms=", ".join(f"{CALLED[arm]} ({n})" for arm, n in f.true_arms.items())
    )


def by_arm(trials: Trials, value: str, of: str = "name") -> list[Row]:
    """A quantity of every model, or of what another column names, by true arm; nothing of one arm."""
    several = len(trials.values("true_arm")) > 1
    return merged(trials.keep(of, "true_arm", value), of, "true_arm") if several else []


def arm_table(rows: Table, value: Column, of: str = "name") -> Table:
    """The same with a column a true arm."""
    name, arm = columns(f"{of} true_arm")
    return pivot(rows, name, arm, value)


def error_map(trials: Trials, compared: Sequence[str]) -> ErrorPlaces:
    """Errors of the first seed pose by pose, ordered by those models that are compared."""
    drawn = trials.where(seed=trials["seed"][0])
    at = Places(**nested({name: cells[0] for name, cells in drawn.keep("places.").columns.items()}).places)
    mm = dict(zip(drawn["name"], drawn["place_mm"], strict=True))
    return error_places(at, mm, [name for name in dict.fromkeys(compared) if name in mm])


def write(report: Report, folder: Path, made: tuple[Cell, Campaign, Sequence[Result]], size: float) -> Seen:
    """dataset.csv of the first seed; what is drawn of it, see `draw`."""
    cell, campaign, _ = made
    write_csv(campaign.measured, cell.arm, folder / "dataset.csv")
    return draw(report, made, size)


def draw(report: Report, made: tuple[Cell, Campaign, Sequence[Result]], size: float) -> Seen:
    """What page and recording draw of the first seed.

    Args:
        report: It has `models` and `map`.
        made: The first seed's true arm, campaign and results, of the models that are told at least.
        size: Magnification of the drawn deflections [1].
    """
    cell, campaign, every = made
    f, known = Row(report.numbers), {result.model.name: result for result in every}
    models = [model for model in distinct(f.models) if model.name in known]
    results = [known[model.name] for model in models]
    return calibration_seen((cell, campaign, results), models, f.map, size)

"""What the trials say: every method over the family of true arms and priors, beside joints alone."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import build_cell, draw_poses, simulate_at
from testbench.bench.rows import UM
from testbench.bench.truths import CALLED, true_cell
from testbench.bench.wrong_prior import PRIOR_WORDS, PRIORS_CALLED
from testbench.data.csvfile import write_csv
from testbench.report.columns import columns
from testbench.report.report import Report, lines, say
from testbench.report.table import Row, Trials
from testbench.studies.study import Run
from testbench.studies.which_model.family import (
    ERROR,
    FAMILY,
    MARGIN,
    WORST_CASES,
    advise,
    chosen,
    gathered,
    judged,
    true_arms,
    worst_arm,
    worst_cases,
)
from testbench.studies.which_model.promises import EVERY, coverage, doubts
from testbench.studies.which_model.trial import CHOSEN, RUNS, Settings, read, scenario
from testbench.trials.spread import middle, span, spans
from testbench.views.colours import CHOICE, Look, look
from testbench.views.figure import Figure, forest
from testbench.views.gains import beside
from testbench.views.markdown import Markdown, counted, listed
from testbench.views.schema import Column, Table, pivot

SHOWN = "cast"  #: The true arm whose readings are left as a dataset.
COVER = "where cases covered_percent by_case_percent half_mm ideal_mm over_ideal"
DOUBTS = "prior_error where cases doubted told unchecked otherwise either"
LOSSES = f"true_arm prior_error poses cases loses over_joints {ERROR}"
WIDTHS = "Half width over the ideal by method, medians"
READING = Markdown(
    "Over joints alone, over the best fixed (the method of least median error at this number of poses, the "
    "default aside) and over the best of the case: error over error, case by case. A method loses where its "
    f"error is more than {100 * MARGIN:g} % above that of joints alone. It is the best in a case where its "
    "error is the least, or as good. The default is averaged with joint stiffness only, weighted by the "
    "evidence of the readings. `--stiffer` asks the same of arms whose links are stiffer than the folder's."
)
OF_COVER = Markdown(
    "Every component of deflection in every pose of the workspace has its interval of 95 %. Covered: the "
    "share of true components inside. Half width: the median over components. Ideal: the narrowest "
    "intervals, all alike in a case, that cover 95 %. The tails of the intervals come from other seeds (1 "
    "to 24) of this very family, so the coverage is that of arms of its kind."
)
OF_DOUBTS = Markdown(
    "With the right prior a doubt is a false alarm where the true arm is the folder's (tubes); elsewhere the "
    "folder itself is wrong. A wrong link that no reading checks cannot be contradicted: then it should be "
    "named. Names tell something only where a link is named more often when it is wrong than when another "
    "one is. A link's deflection is its own over the whole, RMS over the workspace, of the true arm."
)
OF_TRUTHS = Markdown(
    "Off tubes: the median link's relative distance from the nearest beam template, in the metric of that, "
    "in the model's axes. Joints and priors are those of the folder where nothing else is said."
)


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads over the family, by true arm, by prior and by both."""
    every = judged(trials)
    family, by_arm = gathered(every), gathered(every, "true_arm")
    cells = gathered(every, "true_arm", "prior_error")
    known = every.pick(every["prior"].astype(bool) | (every["name"] == CHOSEN))
    default = every.where(name=CHOSEN)
    advice = advise(every, family)
    lost = [m for m in cells if m.name == CHOSEN and m.loses > 0]
    f = Row(
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        arm=find_arm(asked.arm).resolve().name,
        noise=True,
        truth="nonlinear",
        sigma_um=UM * asked.sigma,
        trials=len(seeds),
        workspace_poses=asked.workspace,
        runs_a_pose=RUNS,
        margin_percent=100 * MARGIN,
        stiffer=asked.stiffer,
        advice=advice,
        family=family,
        by_truth=by_arm,
        by_prior=gathered(known, "prior_error"),
        cells=cells,
        losses=sorted(lost, key=lambda m: (-m.loses, -middle(m.over_joints))),
        worst_arm=worst_arm(by_arm, advice[0]),
        worst=worst_cases(default),
        chosen=chosen(default),
        cover=coverage(every),
        doubts=doubts(default),
        truths=true_arms(default),
        priors=PRIOR_WORDS,
    )
    return Report(
        scenario="which_model",
        question=say(
            "{arm}: which method should an engineer use by default with {poses} poses?",
            f,
            poses=listed([str(a.poses) for a in advice], "or"),
        ),
        title=_title(f),
        answer=lines(_answer(advice[0])),
        worst=lines(_where_worst(f)),
        claims=list(_claims(f)),
        numbers=f,
        tables=_tables(f),
        body=_body(f),
    )


def looks_of(rows: Sequence[Row]) -> dict[str, Look]:
    """How methods are drawn."""
    return {m.name: CHOICE if m.name == CHOSEN else look(m.structure, m.constraint, m.prior) for m in rows}


def _tables(f: Row) -> dict[str, Table]:
    """Methods by poses over the family, by true arm and by prior; where the default loses, what it says."""
    name, where, covered, wide, error = columns(f"name where covered_percent over_ideal {ERROR}")
    exact = replace(error, exact=True)
    found: dict[str, Table] = {}
    for a in f.advice:
        found |= _with_poses(f, a.poses, exact)
    intervals = (
        ("covered", "Share covered by method, %", covered),
        ("widths", WIDTHS, replace(wide, exact=True)),
    )
    return {
        "short": _over_family(f, exact),
        **found,
        "chosen": Table(columns("poses chosen cases share"), f.chosen, "What the default chooses"),
        "losses": Table(columns(LOSSES), f.losses, "Where the default loses to joints alone"),
        "worst": Table(columns(WORST_CASES), f.worst, "The default's worst cases beside joints alone"),
        "cover": Table(columns(COVER), [c for c in f.cover if c.name == CHOSEN], "Intervals of the default"),
        **{key: pivot(Table((), f.cover, title), where, name, own) for key, title, own in intervals},
        "doubts": Table(columns(DOUBTS), [d for d in f.doubts if d.poses is None], "Doubts about the prior"),
        "truths": Table(columns("true_arm what off_tubes_percent cad_mm"), f.truths, "True arms"),
    }


def _with_poses(f: Row, poses: int, exact: Column) -> dict[str, Table]:
    """Of one number of poses: every method, by true arm and by prior; the default by both."""
    own = {
        key: [m for m in f[key] if m.poses == poses] for key in ("family", "by_truth", "by_prior", "cells")
    }
    name, arm, prior = columns("name true_arm prior_error")
    parts = (
        ("truth", "medians by true arm, mm", own["by_truth"], name, arm, exact),
        ("prior", "medians by prior, of methods that know it, mm", own["by_prior"], name, prior, exact),
        (
            "default",
            "the default's error, mm",
            [m for m in own["cells"] if m.name == CHOSEN],
            arm,
            prior,
            replace(exact, exact=False),
        ),
    )
    looks = looks_of(own["family"])
    return {
        f"family_{poses}": Table(columns(FAMILY), own["family"], f"{poses} poses", CHOSEN, looks=looks)
    } | {
        f"{key}_{poses}": replace(
            pivot(Table((), rows, f"{poses} poses: {title}", CHOSEN), down, across, cell),
            looks=looks if down is name else {},
        )
        for key, title, rows, down, across, cell in parts
    }


def _over_family(f: Row, error: Column) -> Table:
    """Methods by number of poses, in the order of the family."""
    name, poses = columns("name poses")
    rows = Table((), f.family, "RMS error over the workspace, mm", CHOSEN)
    across = replace(poses, heading="poses", unit="poses")
    return replace(pivot(rows, name, across, error), looks=looks_of(f.family))


def _body(f: Row) -> list[Markdown | str]:
    """report.md below the claims."""
    parts = ("family", "truth", "prior", "default")
    by_poses = [f"{part}_{a.poses}" for a in f.advice for part in parts]
    priors = [say("- {name}: {what}.", name=PRIORS_CALLED[key], what=what) for key, what in f.priors.items()]
    return [
        Markdown("![which_model](which_model.png)"),
        "short",
        *by_poses,
        READING,
        *("chosen", "losses", "worst", "cover", "covered", "widths", OF_COVER, "doubts", OF_DOUBTS),
        *("truths", OF_TRUTHS),
        Markdown("\n".join(["## Priors\n", *priors])),
    ]


def _title(f: Row) -> Markdown:
    """What was simulated."""
    stiffer = " True links are {stiffer:g} times stiffer than the folder's." if f.stiffer != 1 else ""
    return say(
        "{arm}, weight of section 6, readings of {sigma_um:g} um, {runs_a_pose} runs a pose, MuJoCo as the "
        "truth: errors of predicted deflection in {workspace_poses} poses never measured. {counted}, in each "
        f"{{arms}} true arms, each with another of {{priors}} priors. Medians ({{ends}} of cases).{stiffer}",
        f,
        counted=counted(f.trials, "trial"),
        arms=len(f.truths),
        priors=len(f.priors),
        ends=span(f.advice[0].default.cases),
    )


def _answer(a: Row) -> Iterator[str]:
    """The default beside least squares and joints alone, with the fewest poses."""
    squares = a.gains.least_squares
    beside = ", least squares {squares:~.3f} mm; {gain:less case}" if squares else ""
    yield say(
        f"{{poses}} poses: default {{default.workspace.rms_mm:~.3f}} mm over the workspace{beside}.",
        a,
        squares=squares and squares.theirs_mm,
        gain=squares,
    )
    yield say("Joints alone {joints.workspace.rms_mm:~.3f} mm, {gain:more case}.", a, gain=a.gains.joints)


def _where_worst(f: Row) -> Iterator[str]:
    """With which true arm, and in which case, the default errs most."""
    squares = ", least squares {least_squares_mm:.3f} mm" if f.worst_arm.least_squares_mm else ""
    yield say(
        f"Worst with {{arm}}, {{poses}} poses, medians: default {{default_mm:.3f}} mm{squares}, joints alone "
        "{joints_mm:.3f} mm.",
        f.worst_arm,
        arm=CALLED[f.worst_arm.true_arm],
    )
    yield say(
        "Worst case beside joints alone: {arm}, prior {prior}, {poses} poses: {workspace.rms_mm:.3f} mm, "
        "{over_joints:.2f} times theirs.",
        f.worst[0],
        arm=CALLED[f.worst[0].true_arm],
        prior=PRIORS_CALLED[f.worst[0].prior_error],
    )


def _claims(f: Row) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    if len(f.advice) > 1:
        others = "; ".join(
            say(
                "with {poses} poses the default errs {default.workspace.rms_mm:~.3f} mm, joints alone "
                "{joints.workspace.rms_mm:~.3f} mm",
                a,
            )
            for a in f.advice[1:]
        )
        yield Markdown(f"{others[:1].upper()}{others[1:]}.")
    yield say("Least error of a fixed method: {best}.", best=_best_with(f, "best"))
    yield say(
        "The default's error is more than {margin_percent:g} % above that of joints alone in {shares:list} "
        "of {cases:,} cases.",
        f,
        shares=[f"{100 * a.default.loses:.1f} %" for a in f.advice],
        cases=f.advice[0].default.cases,
    )
    cover = {own.name: own.covered_percent for own in f.cover if own.where == EVERY}
    yield say(
        "Its 95 % intervals cover {default:.1f} % of the true deflections; those of joints alone, which "
        "count noise and nothing else, {joints:.0f} %.",
        default=cover[CHOSEN],
        joints=cover[JOINTS],
    )
    far = [own for own in f.doubts if own.where == EVERY and own.poses is None and own.told is not None]
    if far:
        yield say(
            "Readings raise a doubt of a prior ten times off: {far}.",
            far="; ".join(
                say("{prior}, in {doubted:yes} of cases", own, prior=PRIORS_CALLED[own.prior_error])
                for own in far
            ),
        )
    yield say("Least error without a prior: {best}.", best=_best_with(f, "without_prior"))
    if free := [m for m in f.family if m.constraint == "free"]:
        yield say(
            "A conservative model that fits as well as least squares exists in {shares:list} of cases with "
            "{poses:list} poses; elsewhere the solution of least squares stays.",
            shares=[f"{100 * m.solved:.0f} %" for m in free],
            poses=[str(m.poses) for m in free],
        )


def _best_with(f: Row, which: str) -> str:
    """A method of least error at every number of poses; each once."""
    found: dict[str, list[str]] = {}
    for a in f.advice:
        found.setdefault(a[which].name, []).append(f"{a.poses} ({middle(a[which].workspace.rms_mm):.3f} mm)")
    return "; ".join(f"{name} with {listed(poses)} poses" for name, poses in found.items())


def figures(found: Report) -> dict[str, Figure]:
    """Error over the workspace of every method over the family, one pane a number of poses."""
    f, [error] = Row(found.numbers), columns(ERROR)
    table, first = _over_family(f, error), f.advice[0]
    name, *drawn = table.columns
    panes = {column.key: column.heading for column in drawn}
    shown = (name, *(replace(column, heading=error.heading, unit="mm") for column in drawn))
    gains = {"least squares": first.gains.least_squares, "joints alone": first.gains.joints}
    return {
        "which_model.png": forest(
            replace(table, columns=shown),
            panes,
            f"{f.arm}, {first.poses} poses, RMS over the workspace: {beside(gains)}",
            "Errors over the family of true arms and priors. Dots: medians, lines: "
            f"{spans((m.workspace.rms_mm for m in f.family), 'cases')}. Band: what testbench chooses from "
            "the readings. Filled: with a prior; dotted line: joints alone.",
            JOINTS,
        )
    }


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    asked, seed = run.settings, run.seeds[0]
    cell = build_cell(find_arm(asked.arm))
    poses = draw_poses(cell, scenario(asked), seed)
    campaign = simulate_at(true_cell(cell, SHOWN, seed), scenario(asked), seed, poses)
    write_csv(read(campaign)[-1], cell.arm, run.folder / "dataset.csv")

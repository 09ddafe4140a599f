"""What the trials say: what noise costs every model, who is best, what better instruments are worth."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS, distinct
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.bench.default import DEFAULT
from testbench.bench.rows import UM
from testbench.bench.truths import member, true_cell
from testbench.data.csvfile import write_csv
from testbench.report import campaigns
from testbench.report.campaigns import ARMS, ERROR, METHODS, RMS, arm_table, duels, named
from testbench.report.columns import KNOWN, columns
from testbench.report.report import Report, lines, say
from testbench.report.table import TRIAL, Row, Trials, matched, merged
from testbench.studies.noise_sensitivity.figure import sensitivity
from testbench.studies.noise_sensitivity.fits import reread
from testbench.studies.noise_sensitivity.instruments import FLAT_SIGMA, NEAR, UNWEIGHTED, WEIGHTED
from testbench.studies.noise_sensitivity.trial import HEAVY, INSTRUMENT, NAME, Settings
from testbench.studies.study import Run
from testbench.trials.spread import Number, grouped, middle, span
from testbench.views.figure import Figure
from testbench.views.markdown import Markdown, listed
from testbench.views.schema import ALIKE, Table, best_of, pivot

PARTS = {"gravity": "KR 500, 8 poses", "six_dof": "108 runs of section 5.2"}
TRACKER_UM = {"gravity": 50.0, "six_dof": 25.0}  #: Noise of the paper's trackers, sections 6 and 5.2.
JUDGED = {"gravity": "workspace", "six_dof": "check"}
SLOPES = "name noise_free_um um_per_um"
PAIRS = "ours theirs sigma_um ratio won tied"
WEIGHTED_OVER = "truth name distance_m ratio won"
INSTRUMENTS = "truth instrument distance_m rms_um"
OF_PART = ("rms", "p95", "slopes", "by_arm", "paired")  #: Tables of a part.
WEIGHTS = ((WEIGHTED, UNWEIGHTED),)
OF_SLOPES = Markdown(
    "The cost of a um of noise is what the largest noise adds in quadrature to the RMS error without noise, "
    "divided by that noise."
)
OF_WEIGHTS = Markdown("Below 1, full covariances are better. On the KR 500; ratios trial by trial.")
OF_INSTRUMENTS = Markdown(
    "The frame drifts by 20 um and 5 urad between the two readings of a run. Lost targets have no weight; "
    "misread ones are not looked for: `identify --robust` does. The instrument of distance 0 reads alike "
    "wherever it stands."
)
OF_PRIOR = Markdown("The prior is twice too soft and 30 % wrong in shape, on purpose.")


def report(asked: Settings, seeds: range, trials: Trials) -> Report:
    """Medians and spreads by part, model and level, and by instrument."""
    parts = {part: _of_part(part, trials.where(part=part)) for part in PARTS}
    read = trials.where(part="instrument")
    near = read.where(distance_m=NEAR)
    case = ("truth", "instrument", "distance_m")
    instruments = merged(read.where(name=INSTRUMENT).drop(TRIAL, "true_arm", "sigma_um", "measured."), *case)
    f = Row(
        campaigns.head(asked.true_arm, seeds, trials),
        truth={"six_dof": "linear", "gravity": "nonlinear", "instrument": "both"},
        default=DEFAULT,
        trials=Row({part: len(own.values(TRIAL)) for (part,), own in trials.groups("part")}),
        sigmas_um=[UM * sigma for sigma in asked.sigmas],
        **{key: Row({part: own[key] for part, own in parts.items()}) for key in parts["gravity"]},
        instruments=instruments,
        instruments_by=INSTRUMENT,
        near_m=NEAR,
        near=_extremes(
            {r.instrument: r.rms_um for r in instruments if r.truth == "linear" and r.distance_m in (0, NEAR)}
        ),
        weighted_over_flat=duels(read, WEIGHTS, "truth", "name", "distance_m", of="instrument"),
        weighted_by_arm=duels(near, WEIGHTS, "truth", "name", "true_arm", of="instrument"),
        conservative=_conservative([row for own in parts.values() for row in own.sweeps]),
        models=[
            m
            for part, own in parts.items()
            for m in campaigns.contract(_near(own), PARTS[part], JUDGED[part])
        ],
        dataset=merged(trials.where(part="gravity", seed=seeds[0]).keep("measured."))[0].measured,
    )
    return Report(
        scenario=NAME,
        question=Markdown("What does tracker noise cost, by method and structure?"),
        title=_title(f),
        answer=lines([_at(f, "gravity"), *campaigns.beside_rivals(_near(parts["gravity"]), f.gains.gravity)]),
        worst=say(
            "Worst at {sigma_um:g} um of noise, {where}: {default} {default_um:~.0f} um, least squares "
            "{least_squares_um:~.0f} um, joints alone {joints_um:~.0f} um.",
            f.worst.gravity,
            where=PARTS["gravity"],
            default=DEFAULT,
        ),
        claims=list(_claims(f, parts)),
        numbers=f,
        tables=_tables(f),
        body=[
            *(name for part in PARTS for name in (f"{part}_{own}" for own in OF_PART)),
            "weighted",
            OF_WEIGHTS,
            "weighted_by_arm",
            "instruments",
            OF_INSTRUMENTS,
        ],
    )


def _of_part(part: str, trials: Trials) -> Row:
    """Every model at every noise, and what is said at that of the paper's tracker and at the largest."""
    levels = merged(
        trials.drop(TRIAL, "true_arm", "instrument", "distance_m", "measured."), "name", "sigma_um"
    )
    noises = trials.values("sigma_um")
    sigma = min(noises, key=lambda own: abs(own - TRACKER_UM[part]))
    models = distinct([row for row in levels if row.sigma_um == sigma])
    here = campaigns.at_case(trials.where(sigma_um=sigma), models)
    last = {row.name: row.rms_um for row in levels if row.sigma_um == max(noises)}
    slopes = _slopes(trials)
    return Row(
        here,
        sweeps=levels,
        slopes=slopes,
        costs=_costs([*slopes.values()]),
        leaders=Row(here.leaders, sigma_um=sigma),
        worst=Row(
            sigma_um=max(noises),
            default_um=last[DEFAULT],
            least_squares_um=last[here.gains.least_squares.theirs],
            joints_um=last[JOINTS],
        ),
        paired=duels(trials.pick(trials["sigma_um"] > 0), campaigns.DUELS, "sigma_um"),
    )


def _near(part: Row) -> list[Row]:
    """The models at the noise of the paper's tracker, a completion only where one exists."""
    return distinct([row for row in part.sweeps if row.sigma_um == part.leaders.sigma_um])


def _slopes(trials: Trials) -> Row:
    """Error without noise, and what the largest noise adds to it in quadrature, per noise, by model."""
    top = max(trials.values("sigma_um"))
    noisy = trials.where(sigma_um=top)
    calm = matched(noisy, trials.where(sigma_um=0.0), ERROR, ("name", TRIAL))
    added = np.sqrt(np.maximum(0, noisy[ERROR] ** 2 - calm**2)) / top
    kept = noisy.keep("name", "structure", "constraint", "prior").add(noise_free_um=calm, um_per_um=added)
    return Row({row.name: row for row in merged(kept, "name")})


def _costs(slopes: Sequence[Row]) -> Row:
    """To which models noise costs least and most, and where a prior helps."""
    plain = {s.structure: s for s in slopes if not s.prior and s.constraint != "free"}
    filled = {s.structure: s for s in slopes if s.prior}
    both = {name: (filled[name], own) for name, own in plain.items() if name in filled}
    return Row(
        plain=_extremes({s.name: s.um_per_um for s in plain.values()}),
        with_prior=_extremes({s.name: s.um_per_um for s in filled.values()}),
        lowered=[n for n, (a, b) in both.items() if middle(a.um_per_um) < (1 - ALIKE) * middle(b.um_per_um)],
        raised_without_noise=[
            n for n, (a, b) in both.items() if middle(a.noise_free_um) > (1 + ALIKE) * middle(b.noise_free_um)
        ],
    )


def _extremes(values: Mapping[str, Number]) -> Row:
    """Who has the least and the largest median, several where they are alike; values are of the first."""
    size = {name: middle(value) for name, value in values.items()}
    least, top = best_of(values).names, max(size.values())
    most = sorted((n for n, own in size.items() if own >= (1 - ALIKE) * top), key=lambda n: -size[n])
    return Row(least=least, least_value=values[least[0]], most=most, most_value=values[most[0]])


def _conservative(levels: Sequence[Row]) -> Row:
    """Least and largest share of conservative fits at any noise, by method in words."""
    found = grouped([row for row in levels if row.sigma_um > 0], _method)
    shares = {words: [float(row.conservative) for row in own] for words, own in found.items()}
    return Row({words: Row(least=min(own), most=max(own)) for words, own in shares.items()})


def _method(row: Row) -> str:
    words = "joints alone" if row.structure == JOINTS else METHODS[row.constraint]
    return f"{words} with prior" if row.prior else words


def _title(f: Row) -> Markdown:
    """What was simulated."""
    return say(
        "Noise of {least:g} to {most:g} um a reading and axis, the same random numbers at every level: "
        "{trials.six_dof} trials of 108 runs of section 5.2, {trials.gravity} of the KR 500 in 8 poses, "
        "{trials.instrument} of several instruments. {arms} Errors are RMS, against the truth: of the KR 500 "
        "over the workspace, else in the check runs. Medians ({ends}).",
        f,
        least=f.sigmas_um[0],
        most=f.sigmas_um[-1],
        arms=campaigns.arms_told(f),
        ends=span(f.trials.gravity),
    )


def _at(f: Row, part: str) -> Markdown:
    """Where something holds: a part, at the noise of its tracker."""
    return say("{where}, {sigma_um:g} um of noise:", f.leaders[part], where=PARTS[part])


def _claims(f: Row, parts: Mapping[str, Row]) -> Iterator[Markdown]:
    """What else there is to say, what matters most first."""
    yield lines([_at(f, "six_dof"), *campaigns.beside_rivals(_near(parts["six_dof"]), f.gains.six_dof)])
    yield _cost(f, "gravity")
    here = [d for d in f.paired.gravity if d.sigma_um == f.leaders.gravity.sigma_um]
    yield campaigns.by_cone(f", {PARTS['gravity']}, {f.leaders.gravity.sigma_um:g} um", here)
    ratios = [middle(row.ratio) for row in f.weighted_over_flat if row.distance_m == NEAR]
    yield say(
        "Laser tracker at {near_m:g} m: full covariances help in {n} of {of} cases; error over that of flat "
        "weights {least:.2f} to {most:.2f} in the median.",
        f,
        n=sum(ratio < 1 - ALIKE for ratio in ratios),
        of=len(ratios),
        least=min(ratios),
        most=max(ratios),
    )
    yield OF_PRIOR
    yield _cost(f, "six_dof")
    yield OF_SLOPES
    yield ARMS
    yield say(
        "The prior's common scale is fitted to the data. {default} learns from the readings how wrong it is "
        "by link and joint; the others believe each entry to 30 %.",
        f,
    )
    for part in PARTS:
        yield say(
            "{at} least error {best} {best_um:.0f} um, without a prior {plain} {plain_um:.0f} um.",
            f.leaders[part] | {name: named(f.leaders[part][name]) for name in ("best", "plain")},
            at=_at(f, part),
        )
        yield say(
            "{where}: at the largest noise the prior lowers the cost of noise to {lowered}; without noise it "
            "raises the error of {raised}.",
            where=PARTS[part],
            lowered=listed(f.costs[part].lowered) or "no structure",
            raised=listed(f.costs[part].raised_without_noise) or "none",
        )
    yield say(
        "Conservative, of all noisy fits: {shares} of the trials.",
        shares=", ".join(
            say("{words} in {least:yes}" + " to {most:yes}" * (own.most != own.least), own, words=words)
            for words, own in f.conservative.items()
        ),
    )
    yield say(
        "Instruments at {near_m:g} m, linear truth, {instruments_by}: least error {near.least_value:.0f} um "
        "({least}), largest {near.most_value:.0f} um ({most}).",
        f,
        least=named([f'"{name}"' for name in f.near.least]),
        most=named([f'"{name}"' for name in f.near.most]),
    )


def _cost(f: Row, part: str) -> Markdown:
    own = f.costs[part]
    return say(
        "{where}: 1 um of noise costs {plain.least_value:~.2f} um of error with {least}, "
        "{plain.most_value:~.2f} um with {most}. With a prior it costs least with {filled}: "
        "{with_prior.least_value:~.2f} um.",
        own,
        where=PARTS[part],
        least=named(own.plain.least),
        most=named(own.plain.most),
        filled=named(own.with_prior.least),
    )


def _tables(f: Row) -> dict[str, Table]:
    """Errors by model and noise, for people who read and for 80 columns; what they say; instruments."""
    found = {}
    for part, words in PARTS.items():
        rows, title = f.sweeps[part], f"{words}: RMS error, um, by noise of a reading"
        name, sigma, rms, p95 = columns(f"name sigma_um {ERROR} p95_um")
        found[f"{part}_short"] = pivot(
            Table((), campaigns.existing(rows), title), name, sigma, replace(RMS, exact=True)
        )
        found[f"{part}_rms"] = pivot(Table((), rows, title), name, sigma, replace(rms, form=".1f"))
        found[f"{part}_p95"] = pivot(Table((), rows, title.replace("RMS", "95 %")), name, sigma, p95)
        found[f"{part}_slopes"] = Table(
            columns(SLOPES), [*f.slopes[part].values()], f"{words}: what noise costs"
        )
        found[f"{part}_by_arm"] = arm_table(
            Table((), f.by_arm[part], f"{_at(f, part)} RMS error, um, by true arm"), RMS
        )
        found[f"{part}_paired"] = Table(columns(PAIRS), f.paired[part], f"{words}: on the same readings")
    laser = "Laser tracker: full covariances over flat weights"
    found["weighted"] = Table(columns(WEIGHTED_OVER), f.weighted_over_flat, laser)
    arms = [Row(row, name=f"{row.truth} truth, {row.name}") for row in f.weighted_by_arm]
    found["weighted_by_arm"] = arm_table(
        Table((), arms, f"{laser} at {NEAR:g} m, by true arm"), KNOWN["ratio"]
    )
    found["instruments"] = Table(columns(INSTRUMENTS), f.instruments, f"Instruments, {INSTRUMENT}")
    return found


def figures(found: Report) -> dict[str, Figure]:
    """Error against noise for both arms, and against distance for the instruments."""
    f = Row(found.numbers)
    answer = f"{_at(f, 'gravity')} {campaigns.gains_told(f.gains.gravity)}"
    return {"noise_sensitivity.png": sensitivity(f, PARTS, answer)}


def write(run: Run[Settings]) -> None:
    """dataset.csv of the first seed."""
    seed = run.seeds[0]
    cell = true_cell(build_cell(find_arm(HEAVY)), member(run.settings.true_arm, seed), seed)
    clean = simulate(cell, Scenario(arm=HEAVY, noise=False), seed).identification
    write_csv(reread(clean, FLAT_SIGMA, stream(seed, 1)), cell.arm, run.folder / "dataset.csv")

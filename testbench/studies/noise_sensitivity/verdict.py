"""What the errors of all trials say: what noise costs whom, who is best, who beats whom."""

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.bench.baselines import JOINTS, is_least_squares
from testbench.bench.default import DEFAULT
from testbench.bench.rows import UM
from testbench.errors import Array
from testbench.studies.noise_sensitivity.by_arm import ByArm, by_arm
from testbench.studies.noise_sensitivity.fits import Fits
from testbench.studies.noise_sensitivity.instruments import UNWEIGHTED, WEIGHTED
from testbench.studies.noise_sensitivity.report import (
    Compared,
    Costs,
    Extremes,
    Gains,
    Leaders,
    Level,
    Paired,
    Shares,
    Slope,
    Weighted,
    Worst,
)
from testbench.studies.noise_sensitivity.trial import DEFAULT_PARTS, INSTRUMENT, TRUTHS, Part
from testbench.trials.gain import Gain, gained
from testbench.trials.spread import Number, Spread, grouped, middle, spread, triple, wins
from testbench.views.schema import ALIKE, best_of

NEAREST: dict[Part, float] = {"six_dof": 25.0, "gravity": 50.0}
"""Noise of the paper's trackers [um], sections 5.2 and 6."""
BY_CONE = (("MGCO56", "MLS56"), ("MGCO56 + prior", "MLS56 + prior"))
PAIRS = (*BY_CONE, ("MGCO56", JOINTS), ("MGCO56 + prior", JOINTS), (DEFAULT, JOINTS))
"""What the cone does without a prior and with it, then both and the default against the incumbent."""

Groups = Mapping[tuple[Part, str, float], Fits]
"""Fits of all trials by part, model and level."""


def _noises(groups: Groups, part: Part) -> list[float]:
    """The levels of a part that are above 0 [m]."""
    return sorted({x for where, _, x in groups if where == part and x > 0})


def _um(groups: Groups, part: Part, model: str, x: float) -> Array:
    """Errors of a model, trial by trial [um]."""
    return groups[part, model, x].rms_um


def slopes(groups: Groups, part: Part) -> dict[str, Slope]:
    """Error without noise, and what the largest noise adds to it, by model."""
    found, top = {}, max(_noises(groups, part))
    for (where, name, x), own in groups.items():
        if where == part and x == 0:
            calm, noisy = (_um(groups, part, name, level) for level in (0.0, top))
            added = np.sqrt(np.maximum(0, noisy**2 - calm**2)) / (UM * top)
            found[name] = Slope(
                model=name,
                structure=own.structure[0],
                constraint=own.constraint[0],
                prior=bool(own.prior[0]),
                noise_free_um=spread(calm),
                um_per_um=spread(added),
            )
    return found


def costs(slopes: Sequence[Slope]) -> Costs:
    """To which models noise costs least and most, and where a prior helps."""
    plain = {s.structure: s for s in slopes if not s.prior and s.constraint != "free"}
    filled = {s.structure: s for s in slopes if s.prior}
    less, more = 1 - ALIKE, 1 + ALIKE
    both = {n: (filled[n], own) for n, own in plain.items() if n in filled}
    lowered = [n for n, (a, b) in both.items() if a.um_per_um.median < less * b.um_per_um.median]
    raised = [n for n, (a, b) in both.items() if a.noise_free_um.median > more * b.noise_free_um.median]
    return Costs(
        plain=extremes({s.model: s.um_per_um for s in plain.values()}),
        with_prior=extremes({s.model: s.um_per_um for s in filled.values()}),
        lowered=tuple(lowered),
        raised_without_noise=tuple(raised),
    )


def extremes(values: Mapping[str, Number]) -> Extremes:
    """The names of the least and of the largest median."""
    size = {name: middle(value) for name, value in values.items()}
    least, top = best_of(values).names, max(size.values())
    most = sorted((n for n, v in size.items() if v >= (1 - ALIKE) * top), key=lambda n: -size[n])
    return Extremes(least, _spread(values[least[0]]), tuple(most), _spread(values[most[0]]))


def _spread(value: Number) -> Spread:
    return value if isinstance(value, Spread) else Spread(*triple(value))


def leaders(part: Part, levels: Sequence[Level]) -> Leaders:
    """Who is best at the noise of the paper's tracker."""
    own = {level.model: level for level in nearest(part, levels)}
    plain = {n: level.rms_um for n, level in own.items() if not level.prior and n != JOINTS}
    best = best_of({n: level.rms_um for n, level in own.items()}).names
    first = best_of(plain).names
    return Leaders(
        noise_um=UM * own[JOINTS].x,
        best=best,
        best_um=own[best[0]].rms_um,
        default_um=own[DEFAULT].rms_um,
        plain=first,
        plain_um=plain[first[0]],
        joints_um=own[JOINTS].rms_um,
    )


def gains(groups: Groups, part: Part, levels: Sequence[Level]) -> Gains:
    """The default beside the best of least squares without a prior and beside joints alone."""
    own = nearest(part, levels)
    plain = {n.model: n.rms_um for n in own if is_least_squares(n.structure, n.constraint, prior=n.prior)}

    def gain(theirs: str) -> Gain:
        a, b = (_um(groups, part, name, own[0].x) / 1e3 for name in (DEFAULT, theirs))
        return gained(DEFAULT, theirs, a.tolist(), b.tolist())

    return Gains(gain(best_of(plain).names[0]), gain(JOINTS))


def worst(levels: Sequence[Level], least_squares: str) -> Worst:
    """Errors at the largest noise."""
    top = max(level.x for level in levels)
    own = {level.model: level.rms_um for level in levels if level.x == top}
    return Worst(UM * top, *(own[name] for name in (DEFAULT, least_squares, JOINTS)))


def errors_by_arm(groups: Groups, part: Part, led: Leaders) -> list[ByArm]:
    """The errors of the leaders, of the default and of joints alone that differ by true arm [um]."""
    names = dict.fromkeys((*led.best, DEFAULT, *led.plain, JOINTS))
    own = {name: fits for (where, name, x), fits in groups.items() if (where, UM * x) == (part, led.noise_um)}
    return [row for name in names for row in by_arm(name, own[name].true_arm, own[name].rms_um)]


def weighted_by_arm(groups: Groups, near: float) -> list[ByArm]:
    """Ratios of full covariances over flat weights at a distance [m] that differ by true arm."""
    found = []
    for part, model, x in groups:
        if (model, x) == (WEIGHTED, near):
            full, flat = groups[part, WEIGHTED, x], groups[part, UNWEIGHTED, x]
            headline = f"{TRUTHS[part]}, {_identified_by(part)}"
            found += by_arm(headline, full.true_arm, full.rms_um / flat.rms_um)
    return found


def _identified_by(part: Part) -> str:
    """The model to which instruments are given."""
    return DEFAULT if part in DEFAULT_PARTS.values() else INSTRUMENT


def nearest(part: Part, levels: Sequence[Level]) -> list[Level]:
    """The models at the level nearest the paper's trackers, a completion only where one exists."""
    own = min({level.x for level in levels}, key=lambda x: abs(UM * x - NEAREST[part]))
    return [fit for fit in levels if fit.x == own and (fit.constraint != "free" or fit.conservative)]


def weighted(groups: Groups) -> list[Weighted]:
    """Full covariances against flat weights at every distance."""
    found = []
    for part, model, x in groups:
        if model == WEIGHTED:
            full, flat = (_um(groups, part, name, x) for name in (WEIGHTED, UNWEIGHTED))
            medians = {"full covariances": float(np.median(full)), "flat weights": float(np.median(flat))}
            found.append(
                Weighted(
                    truth=TRUTHS[part],
                    model=_identified_by(part),
                    distance_m=x,
                    ratio=spread(full / flat),
                    better_in=wins(full, flat) / len(full),
                    trials=len(full),
                    better=best_of(medians).names,
                )
            )
    return found


def paired(groups: Groups, part: Part) -> list[Paired]:
    """Every pair at every noise."""
    return [_pair(groups, part, *names, x) for names in PAIRS for x in _noises(groups, part)]


def _pair(groups: Groups, part: Part, ours: str, theirs: str, x: float) -> Paired:
    a, b = (_um(groups, part, name, x) for name in (ours, theirs))
    better, worse = wins(a, b), wins(b, a)
    return Paired(
        part=part,
        ours=ours,
        theirs=theirs,
        sigma_um=UM * x,
        ratio=spread(a / b),
        better_in=better / len(a),
        alike_in=1 - (better + worse) / len(a),
    )


def compared(rows: Sequence[Paired]) -> list[Compared]:
    """Every pair over all noise."""
    return [
        Compared(
            ours=names[0],
            theirs=names[1],
            cone=names in BY_CONE,
            sigmas_um=tuple(p.sigma_um for p in own),
            better_in=tuple(p.better_in for p in own),
            alike_in=tuple(p.alike_in for p in own),
        )
        for names, own in grouped(rows, lambda p: (p.ours, p.theirs)).items()
    ]


def shares(values: Sequence[float]) -> Shares:
    """The least and the largest."""
    return Shares(min(values), max(values))

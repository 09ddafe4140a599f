"""Doubts about loads and deflections: the mistake that makes them fit the prior best."""

import math
from functools import partial

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset, select
from testbench.errors import Array, BenchError
from testbench.identify.diagnosis.finding import Finding, one_by_one
from testbench.identify.diagnosis.loads import Learnt, learnt, of_all, of_runs, other_loads
from testbench.identify.diagnosis.mounting import (
    DOWN,
    TILTED,
    Pull,
    angle,
    finding,
    loads_as,
    suspected,
    weights,
)
from testbench.identify.fold import reduce
from testbench.identify.metric import Metric
from testbench.model.vjm import Vjm

LEAST, ONE_OF_MANY = 7.0, 12.0
"""Nats by which a mistake has to make the readings likelier to be a doubt; of a single run or level."""
CLEAR = 20.0  #: The same where all readings are changed at once: a force along another axis, other levels.
SINGLE = ("run_load", "run", "reading")  #: Kinds of mistakes of single runs.
LARGE = {"force_offset": 0.045, "load_point": 0.05, "tracker_moved": 4e-4, "level": 0.08, "run_load": 0.4}
"""Least sizes that are a doubt: sound arms, which stiffen, have play and compensators, look as wrong as this.
Of the largest force [1]; [m]; [m, rad]; of the load [1]."""
BUMP = 4e-4  #: The same of a single reading [m], and of SIGMAS standard deviations.
SIGMAS = 8.0
SCALES, HALF, LIGHT = 5.0, 4.5, 0.35
"""Factors between prior and readings that are absurd, and that are with forces that are light as newtons,
under LIGHT of the stated payload, and not as kilograms."""
QUIET = 1.3, 2.5
"""Misfit, and factor between prior and readings, up to which no mistake of all readings is looked for."""
NOISE, SHARE_OF_MOVE = 8.0, 0.005
"""Misfit, and share of the deflections, from which the stated noise is doubted: models leave that much."""
FALL, FEWEST = 0.5, 5
"""Misfit without a run over that with it, from which the run alone is wrong; runs of which one may be."""
WORTH = 3.0  #: Nats from which a run is left out on trial: strong evidence (Kass and Raftery 1995).
RIVAL = 0.8  #: Share of another mistake's nats from which a mounting is preferred to it.
SHARE = 0.5  #: What evidence for a single run counts against that for a mistake of all.


def scale(vjm: Vjm, metric: Metric, data: Dataset) -> float:
    """By what factor the readings want the prior's compliances, by least squares [1]."""
    regression = reduce(vjm, metric.structure, data)
    pi = metric.L @ metric.expected
    rows = [(t.R @ pi, t.z) for t in regression.terms]
    return float(sum(a @ z for a, z in rows) / sum(a @ a for a, _ in rows))


def deflected(vjm: Vjm, metric: Metric, data: Dataset, level: Array | None = None) -> list[Finding]:
    """Doubts about loads and deflections, the likeliest first.

    Args:
        vjm: The model.
        metric: What is expected of its compliances.
        data: The runs.
        level: Gravity in the folder's world if the tracker stands level, (3,); None if nothing says.
    """
    factor, pull = scale(vjm, metric, data), suspected(vjm, metric, data, level)
    if pull is not None and pull.plain:
        return [finding(vjm, pull)]
    try:
        found, kept, own = one_by_one(data, learnt(vjm, metric, data), partial(_without_worst, vjm, metric))
    except BenchError:  # no compliance moves so: only other loads can
        hung = [] if pull is None else _mounted(None, vjm, metric, data, pull)
        return hung or _other(None, vjm, metric, data) or [_wild(factor, data)]
    best = _best(own)
    pull = pull or _missing(kept, best, level)
    hung = [] if pull is None else _mounted(own.loss, vjm, metric, kept, pull)
    rival = max((_nats(one) for one in best if one.kind != "force_offset"), default=0.0)  # no weight has one
    if hung and (hung[0].beside["level"] or _nats(hung[0]) > RIVAL * rival):
        return [*hung, *(one for one in (*found, *best) if one.kind in SINGLE)]
    found += best
    if own.misfit > QUIET[0] or not 1 / QUIET[1] < factor < QUIET[1]:
        found += _other(own.loss, vjm, metric, kept)
    found.sort(key=lambda one: -(one.nats or 0) * (SHARE if one.kind in SINGLE else 1))
    found += _scale(vjm, data, factor)
    typical = float(np.median(np.linalg.norm(data.deflection, axis=2)[data.seen]))
    if not found and own.misfit > NOISE and own.misfit * data.sigma > SHARE_OF_MOVE * typical:
        found.append(Finding("noise", beside={"factor": own.misfit, "sigma": data.sigma}))
    return found


def _missing(data: Dataset, best: list[Finding], level: Array | None) -> Pull | None:
    """Where weights pull to, if a constant force beside them explains the readings best; else None."""
    if level is not None or not best or best[0].kind != "force_offset" or not weights(data):
        return None
    total = data.wrench[:, :3].mean(axis=0) + best[0].size
    pull = Pull(total / np.linalg.norm(total))
    return pull if angle(pull.g, DOWN) > TILTED else None


def _mounted(loss: float | None, vjm: Vjm, metric: Metric, data: Dataset, pull: Pull) -> list[Finding]:
    """How the base stands, where weights from there explain the readings; loss None if nothing does."""
    try:
        own = learnt(vjm, metric, loads_as(data, pull.g))
    except BenchError:  # moves against the force
        return []
    nats = None if loss is None else loss - own.loss
    if own.misfit > NOISE if nats is None else nats < (LEAST if pull.told else CLEAR):
        return []
    return [finding(vjm, pull, nats)]


def _without_worst(
    vjm: Vjm, metric: Metric, data: Dataset, own: Learnt
) -> tuple[list[Finding], Dataset, Learnt] | None:
    """The run that alone makes all others look noisy, and the others without it; None if none does.

    It is weighed by what the others say of noise and prior: its own mistake would hide in theirs.
    """
    if own.misfit <= QUIET[0] or data.runs < FEWEST:
        return None
    likeliest = max(of_runs(own), key=_nats)
    if _nats(likeliest) < WORTH:
        return None
    worst = likeliest.where[0]
    others = data.run.astype(str) != worst
    rest = learnt(vjm, metric, select(data, others))
    if rest.misfit > FALL * own.misfit:
        return None
    seen = learnt(vjm, metric, data, rest.h)
    found = [one for one in of_runs(seen) if one.where[0] == worst and _large(seen, one)]
    return ([max(found, key=_nats)], rest.data, rest) if found else None


def _nats(found: Finding) -> float:
    return found.nats or 0.0


def _best(own: Learnt) -> list[Finding]:
    """The likeliest mistake; and where it is of a single run, what else is of another single run."""
    found: list[Finding] = []
    large = [one for one in (*of_all(own), *of_runs(own)) if _large(own, one)]
    for one in sorted(large, key=_nats, reverse=True):
        runs = {other.where[0] for other in found if other.kind in SINGLE}
        if not found or (runs and one.kind in SINGLE and one.where[0] not in runs):
            found.append(one)
    return found


def _large(own: Learnt, one: Finding) -> bool:
    """Whether a mistake is likely, and larger than those of sound arms."""
    if (one.nats or 0) <= (ONE_OF_MANY if one.kind in ("level", *SINGLE) else LEAST):
        return False
    size = np.abs(one.size)
    if one.kind in ("run", "reading"):
        return bool(np.linalg.norm(size) > max(BUMP, SIGMAS * own.data.sigma * own.misfit))
    if one.kind == "force_offset":
        size = size / np.linalg.norm(own.data.wrench[:, :3], axis=1).max()
    return bool(size.max() > LARGE[one.kind])


def _other(loss: float | None, vjm: Vjm, metric: Metric, data: Dataset) -> list[Finding]:
    """The mistake of all loads that explains the readings best, if one does; loss None if nothing so far."""
    tried = []
    for kind, where, other in other_loads(vjm, data):
        try:
            own = learnt(vjm, metric, other)
        except BenchError:  # moves against the force
            continue
        nats = None if loss is None else loss - own.loss
        tried.append((own.loss, own.misfit, Finding(kind, where, nats=nats)))
    if not tried:
        return []
    least, misfit, found = min(tried, key=lambda x: x[0])
    clear = misfit <= NOISE if loss is None else loss - least >= CLEAR
    return [found] if clear else []


def _wild(factor: float, data: Dataset) -> Finding:
    """Deflections that are no arm's: a wild one may outweigh all others."""
    size = np.where(data.seen, np.linalg.norm(data.deflection, axis=-1), 0)
    (i, k), median = np.unravel_index(np.argmax(size), size.shape), float(np.median(size[data.seen]))
    where = (data.markers[k], str(data.run[i]))
    return Finding("scale", where, beside={"factor": factor, "largest": float(size[i, k]), "median": median})


def _scale(vjm: Vjm, data: Dataset, factor: float) -> list[Finding]:
    """Whether the factor between prior and readings is absurd."""
    size = abs(math.log(max(abs(factor), 1e-12)))
    force = float(np.linalg.norm(data.wrench[:, :3], axis=1).max())
    payload = vjm.arm.payload
    light = payload is not None and LIGHT * payload < force < LIGHT * payload * GRAVITY
    if size <= math.log(SCALES) and not (light and factor > HALF):
        return []
    return [Finding("scale", beside={"factor": factor, "force": force}, nats=size**2 / 2)]

"""Which single mistake in the loads, or between the two readings, makes deflections fit the prior best."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset
from testbench.errors import BenchError
from testbench.identify.doubts.doubt import Doubt, three
from testbench.identify.doubts.loads import Fitted, learnt
from testbench.identify.doubts.suspects import Suspect, levels, suspects
from testbench.identify.fold import reduce
from testbench.identify.metric import Metric
from testbench.model.vjm import Vjm, tool_pose

LEAST, ONE_OF_MANY = 7.0, 12.0
"""Nats by which a mistake has to make the readings likelier to be a doubt; of a single run or level."""
CLEAR = 20.0  #: The same where all readings are changed at once: a force along another axis, other levels.
SINGLE = ("run_load", "run", "reading")  #: Names of mistakes of single runs.
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
SHARE = 0.5  #: What evidence for a single run counts against that for a mistake of all.


def _largest(factor: float, data: Dataset) -> str:
    """Deflections that are no arm's, in words: a wild one may outweigh all others."""
    size = 1e3 * np.where(data.seen, np.linalg.norm(data.deflection, axis=-1), 0)
    (i, k), middle = np.unravel_index(np.argmax(size), size.shape), np.median(size[data.seen])
    return (
        f"as a whole the deflections are {factor:.3g} times what the arm's folder predicts; the largest is "
        f"{size[i, k]:.3g} mm, {data.markers[k]} in run {data.run[i]}, the median {middle:.3g} mm: "
        "is that reading wrong, or are loaded readings of other runs?"
    )


def deflected(vjm: Vjm, metric: Metric, data: Dataset) -> list[Doubt]:
    """Doubts about loads and deflections, the likeliest first."""
    factor = scale(vjm, metric, data)
    try:
        fitted = learnt(vjm, metric, data)
    except BenchError:  # no compliance moves so: only other loads can
        said = _changed(None, vjm, metric, data)
        return said or [Doubt("scale", _largest(factor, data))]
    found = [s for s in suspects(fitted) if s.size.gain > _least(s) and _large(fitted, s)]
    found.sort(key=lambda s: -s.size.gain)
    kappa = math.exp(fitted.h[-1])
    suspicious = kappa > QUIET[0] or not 1 / QUIET[1] < factor < QUIET[1]
    said = [Doubt(s.name, _sentence(s), _gain(fitted, s, again=suspicious)) for s in _told(found)]
    if suspicious:
        said += _changed(fitted.loss, vjm, metric, data)
    said.sort(key=lambda d: -(d.evidence or 0) * (SHARE if d.name in SINGLE else 1))
    said += _scale(vjm, data, factor)
    typical = float(np.median(np.linalg.norm(data.deflection, axis=2)[data.seen]))
    if not said and kappa > NOISE and kappa * data.sigma > SHARE_OF_MOVE * typical:
        words = (
            f"the readings scatter {kappa:.2g} times more than their noise, {1e6 * data.sigma:.3g} um: is it "
            "more, or does the arm do what springs do not?"
        )
        said.append(Doubt("noise", words))
    return said


def single(vjm: Vjm, metric: Metric, data: Dataset) -> list[Doubt]:
    """Doubts about single runs alone."""
    try:
        fitted = learnt(vjm, metric, data)
    except BenchError:
        return []
    found = [s for s in suspects(fitted) if s.name in SINGLE and s.size.gain > _least(s)]
    found = sorted((s for s in found if _large(fitted, s)), key=lambda s: -s.size.gain)
    return [Doubt(s.name, _sentence(s), s.size.gain) for s in _told(found)]


def _gain(fitted: Fitted, suspect: Suspect, *, again: bool) -> float:
    """How much likelier a mistake makes the readings [nats]; one of all runs is learnt anew if asked."""
    if suspect.mend is None or not again:
        return suspect.size.gain
    try:
        mended = learnt(fitted.vjm, fitted.metric, suspect.mend(fitted.data, suspect.size.b))
    except BenchError:  # mended by so much that targets move against the force
        return suspect.size.gain
    return max(suspect.size.gain, fitted.loss - mended.loss)


def scale(vjm: Vjm, metric: Metric, data: Dataset) -> float:
    """By what factor the readings want the prior's compliances, by least squares [1]."""
    regression = reduce(vjm, metric.structure, data)
    pi = metric.L @ metric.expected
    rows = [(t.R @ pi, t.z) for t in regression.terms]
    return float(sum(a @ z for a, z in rows) / sum(a @ a for a, _ in rows))


def _told(found: list[Suspect]) -> Iterator[Suspect]:
    """The likeliest mistake; and where it is of a single run, what else is of a single run."""
    if not found:
        return
    yield found[0]
    if found[0].name not in SINGLE:
        return
    told = {found[0].where.split()[0]}
    for other in found[1:]:
        run = other.where.split()[0] if other.where else ""
        if other.name in SINGLE and run not in told:
            told.add(run)
            yield other


def _least(suspect: Suspect) -> float:
    return ONE_OF_MANY if suspect.name in ("level", *SINGLE) else LEAST


def _large(fitted: Fitted, suspect: Suspect) -> bool:
    size = suspect.unit * suspect.size.b
    if suspect.name in ("run", "reading"):
        sigma = fitted.data.sigma * math.exp(fitted.h[-1])
        return bool(np.linalg.norm(size) > max(BUMP, SIGMAS * sigma))
    if suspect.name == "force_offset":
        size = size / np.linalg.norm(fitted.data.wrench[:, :3], axis=1).max()
    return bool(np.abs(size).max() > LARGE[suspect.name])


def _sentence(suspect: Suspect) -> str:
    b = suspect.unit * suspect.size.b
    if suspect.name == "force_offset":
        return f"a constant force of ({three(b, 1, 0)}) N is missing in every load: the sensor's zero?"
    if suspect.name == "load_point":
        return f"the load acts ({three(b, 1e3, 0)}) mm from the stated point, in the tool's axes"
    if suspect.name == "tracker_moved":
        turn = f"({three(b[3:], 1e3, 2)}) mrad"
        which = f"the loaded readings of {suspect.where}" if suspect.where else "all loaded readings"
        return f"{which} are moved by ({three(b, 1e3, 2)}) mm and turned by {turn}: did the tracker move?"
    if suspect.name == "level":
        return f"the load of {suspect.where} acts as {1 + b[0]:.2f} times that, beside the others: its mass?"
    if suspect.name == "run_load":
        hint = "its mass" if b[0] > -1 else "before and after exchanged"
        return f"run {suspect.where}: its load acts as {1 + b[0]:.2f} times what is stated: {hint}?"
    away = 1e3 * float(np.linalg.norm(b)) / math.sqrt(len(b) / 3)
    if suspect.name == "run":
        return f"run {suspect.where}: its targets moved otherwise than the load says, by {away:.2g} mm"
    run, target = suspect.where.split(" ", 1)
    return f"run {run}: {target} is {away:.2g} mm from where the others say: touched, or read wrongly?"


@dataclass(frozen=True)
class Changed:
    """A mistake of all loads that is tried as a whole."""

    name: str
    words: str
    data: Dataset  #: With it mended.


def _changed(loss: float | None, vjm: Vjm, metric: Metric, data: Dataset) -> list[Doubt]:
    """The mistake of all loads that explains the readings best, if one does; None if nothing does so far."""
    tried = []
    for change in _changes(vjm, data):
        try:
            tried.append((learnt(vjm, metric, change.data), change))
        except BenchError:  # moves against the force
            continue
    if not tried:
        return []
    best, found = min(tried, key=lambda pair: pair[0].loss)
    if (loss is None and math.exp(best.h[-1]) > NOISE) or (loss is not None and loss - best.loss < CLEAR):
        return []
    gain = None if loss is None else loss - best.loss
    return [Doubt(found.name, f"the readings fit if {found.words}", gain)]


def _changes(vjm: Vjm, data: Dataset) -> Iterator[Changed]:
    w, rotation = data.wrench, tool_pose(vjm, data.q)[1]
    turned = np.concatenate(
        [np.einsum("rxy,ry->rx", rotation, part) for part in (w[:, :3], w[:, 3:])], axis=1
    )
    yield Changed("force_axes", "forces are in the tool's axes", replace(data, wrench=turned))
    for order, words in (
        ((1, 2, 0), "y, z, x"),
        ((2, 0, 1), "z, x, y"),
        ((1, 0, 2), "y, x, z"),
        ((2, 1, 0), "z, y, x"),
        ((0, 2, 1), "x, z, y"),
    ):
        for sign in (1, -1):
            own = sign * w[:, [*order, *(3 + k for k in order)]]
            minus = "" if sign > 0 else ", with the other sign"
            yield Changed(
                "force_axes", f"the forces' axes x, y, z are {words}{minus}", replace(data, wrench=own)
            )
    groups = levels(data)
    if len(groups) > 1:
        sizes = [np.linalg.norm(w[g, :3], axis=1).mean() for g in groups]
        for shift in range(1, len(groups)):
            own = w.copy()
            for k, g in enumerate(groups):
                own[g] *= sizes[(k + shift) % len(groups)] / sizes[k]
            yield Changed("levels", "the loads have each other's values", replace(data, wrench=own))
        own = w.copy()
        for k, g in enumerate(groups):
            own[g] *= sizes[-1 - k] / sizes[k]
        yield Changed("levels", "the loads stand in reversed order", replace(data, wrench=own))


def _scale(vjm: Vjm, data: Dataset, factor: float) -> list[Doubt]:
    """Whether the factor between prior and readings is absurd."""
    size = abs(math.log(max(abs(factor), 1e-12)))
    force = float(np.linalg.norm(data.wrench[:, :3], axis=1).max())
    payload = vjm.arm.payload
    light = payload is not None and force < LIGHT * payload * GRAVITY and force > LIGHT * payload
    if size <= math.log(SCALES) and not (light and factor > HALF):
        return []
    if factor > 1:
        hint = "forces in kg instead of N (9.81 times), in kN, a heavier load, or a folder too stiff?"
    else:
        hint = "forces in another unit, a lighter load, or a folder too soft?"
    times = f"{factor:,.0f}" if factor > 100 else f"{factor:.3g}"
    words = f"the readings are {times} times what the arm's folder predicts under loads up to {force:,.5g} N"
    stated = "" if payload is None else f" (payload {payload:.4g} kg)"
    return [Doubt("scale", f"{words}{stated}: {hint}", size**2 / 2)]

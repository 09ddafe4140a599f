"""From a calibration to its report."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.bench.absolute import Calibrated
from testbench.bench.absolute_hidden import left_open
from testbench.bench.absolute_places import places
from testbench.bench.absolute_report import (
    AbsoluteReport,
    BlockRow,
    ComplianceRow,
    Errors,
    Noise,
    OrderRow,
    OutlierRow,
    Program,
    SeriesRow,
    SpectrumRow,
    StepRow,
    Value,
)
from testbench.bench.rows import MM, UM
from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.choose import Step
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.intervals import Interval, deviations_root, intervals, own_values
from testbench.identify.absolute.scatter import residuals
from testbench.identify.absolute.shared import aligned
from testbench.identify.absolute.state import State, nominal
from testbench.model.vjm import Vjm

SPOILED = 0.5  #: A reading that counts less than this is listed as an outlier [1].
WORST = 10  #: Outliers that are listed, the farthest.


@dataclass(frozen=True)
class Reported:
    """A report, and the errors behind it for those who draw them."""

    report: AbsoluteReport
    found: Calibrated  #: What it is of.
    as_drawn: State  #: The arm as drawn, every series aligned.
    before: tuple[Array, ...]  #: Reading minus arm as drawn of every series, base axes, (rows, m, 3) [m].
    after: tuple[Array, ...]  #: Reading minus calibrated arm, (rows, m, 3) [m].


def reported(found: Calibrated) -> Reported:
    """The report of a calibration."""
    calibration, series = found.calibration, found.series
    state = calibration.state
    as_drawn = aligned(nominal(state.vjm, state.weights, state.torque_scale), series)
    before, after = (tuple(_left(x, one) for one in series) for x in (as_drawn, state))
    pairs = list(zip(series, before, after, strict=True))
    sizes = [[_sizes(one, x) for one, x in zip(series, every, strict=True)] for every in (before, after)]
    known = intervals(calibration)
    report = AbsoluteReport(
        arm=state.vjm.arm.name,
        series=[SeriesRow(one.name, one.rows, *(errors(_sizes(one, x)) for x in xs)) for one, *xs in pairs],
        total_before=errors(np.concatenate(sizes[0])),
        total_after=errors(np.concatenate(sizes[1])),
        steps=[_step(step) for step in calibration.chosen.steps],
        places=places(state.vjm.arm.joints, _q(series), *(np.concatenate(x) for x in sizes)),
        spectrum=_spectrum(calibration),
        geometry=[_value(one) for one in known if one.part == "geometry"],
        compliances=_compliances(state.vjm, [one for one in known if one.part == "joint compliances"]),
        blocks=_blocks(calibration),
        program=_program(calibration),
        noise=_noise(calibration, series),
        weight_alone=not any(one.wrench.any() or one.torque is not None for one in series),
        less_pull_percent=_less(calibration, series),
        left_open=list(left_open(calibration)),
        outliers=_outliers(calibration, series, after),
        notes=list(found.notes),
    )
    return Reported(report, found, as_drawn, before, after)


def errors(distance: Array) -> Errors:
    """Distances of positions, (n,) [m], in numbers."""
    mm = MM * distance
    rms = float(np.sqrt((mm**2).mean()))
    return Errors(len(mm), float(mm.mean()), rms, float(np.percentile(mm, 95)), float(mm.max()))


def _left(state: State, series: Series) -> Array:
    """Reading minus model of all targets, (rows, m, 3) [m]; zero where one was lost."""
    return np.asarray(residuals(state, series)[: len(series.markers)].transpose(2, 0, 1))


def _sizes(series: Series, left: Array) -> Array:
    """Distances of the positions that were read, (n,) [m]."""
    return np.asarray(np.linalg.norm(left, axis=2)[series.seen])


def _q(series: Sequence[Series]) -> Array:
    """Joints of every position that was read, (n, joints) [rad, m]."""
    return np.concatenate([np.repeat(one.q, one.seen.sum(axis=1), axis=0) for one in series])


def _step(step: Step) -> StepRow:
    """Root mean squares along an axis as those of distances."""
    every = (step.before, step.after, step.series_before, step.series_after)
    mm = [MM * math.sqrt(3) * x if math.isfinite(x) else None for x in every]
    return StepRow(step.name, step.kept, *mm)


def _spectrum(calibration: Calibration) -> list[SpectrumRow]:
    """Amplitudes of every order that is on; the standard deviation is that along the amplitude."""
    unknowns, own = calibration.own.unknowns, calibration.own
    orders, size, first = unknowns.errors.orders, unknowns.errors.size, unknowns.starts["errors"]
    if not orders or not np.isin(first, own.columns):
        return []
    x, root = own_values(calibration), deviations_root(calibration)
    found = []
    for k, joint in enumerate(unknowns.vjm.arm.joints):
        if joint.prismatic:
            continue
        columns = first + k * size + np.arange(2 * len(orders)).reshape(2, -1)  # sines, cosines
        pair = x[columns].T
        amplitude = np.linalg.norm(pair, axis=1)
        along = np.where(amplitude[:, None] > 0, pair, 1.0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        lines = root[np.searchsorted(own.columns, columns)]  # (2, orders, c)
        deviation = np.linalg.norm(np.einsum("oa,aoc->oc", along, lines), axis=1)
        rows = zip(orders, (UM * amplitude).tolist(), (UM * deviation).tolist(), strict=True)
        rms = float(UM * np.sqrt((amplitude**2).sum() / 2))
        found.append(SpectrumRow(joint.name, rms, [OrderRow(*row) for row in rows]))
    return found


def _value(one: Interval) -> Value:
    return Value(one.name, one.value, one.half, one.unit)


def _compliances(vjm: Vjm, known: Sequence[Interval]) -> list[ComplianceRow]:
    """Of every joint what the readings see of it, beside the same of the arm's folder."""
    if not known:
        return []
    found, arm = [], vjm.arm
    for one, joint, link, axis in zip(known, arm.joints, arm.links[:-1], vjm.beam_axes, strict=True):
        part = slice(0, 3) if joint.prismatic else slice(3, 6)
        folder = joint.compliance + float(axis @ link.compliance[part, part] @ axis)
        found.append(ComplianceRow(one.name, one.value, one.half, one.unit, UM * folder))
    return found


def _blocks(calibration: Calibration) -> list[BlockRow]:
    estimate, elastic = calibration.estimate, calibration.own.elastic
    if estimate is None or elastic is None:
        return []
    pairs = zip(elastic.names, estimate.eigenvalues, strict=True)
    return [BlockRow(name, float(values[0]), float(values[-1])) for name, values in pairs]


def _program(calibration: Calibration) -> Program | None:
    estimate = calibration.estimate
    if estimate is None:
        return None
    return Program(
        method=estimate.method,
        constrained=estimate.constraint == "psd",
        status=estimate.status,
        conservative=estimate.conservative,
    )


def _noise(calibration: Calibration, series: Sequence[Series]) -> Noise:
    own = calibration.noise
    return Noise(
        sigma_um=float(UM * np.sqrt(np.mean([one.sigma**2 for one in series]))),
        open_position_um=UM * own.open_position,
        open_rotation_urad=UM * own.open_rotation,
        position_factor=float(own.factor[0]),
    )


def _less(calibration: Calibration, series: Sequence[Series]) -> float:
    """Share of the positions that count less than a sound one, in per cent."""
    every = zip(series, calibration.pulls, strict=True)
    pulls = np.concatenate([pull[: len(one.markers)].T[one.seen] for one, pull in every])
    return float(100 * (pulls < 1).mean())


def _outliers(calibration: Calibration, series: Sequence[Series], after: Sequence[Array]) -> list[OutlierRow]:
    """The farthest of the positions that hardly count."""
    found = []
    for one, pull, left in zip(series, calibration.pulls, after, strict=True):
        size = np.linalg.norm(left, axis=2)
        for row, k in np.argwhere((pull[: len(one.markers)].T < SPOILED) & one.seen):
            name, mm = one.markers[k], MM * float(size[row, k])
            found.append(OutlierRow(one.name, int(one.row[row]), name, mm, float(pull[k, row])))
    return sorted(found, key=lambda row: -row.error_mm)[:WORST]

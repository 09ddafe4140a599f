"""Two runs joined: errors of models of the same names, single numbers, and the inputs that differ."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter, ValidationError

from testbench.arm.document import first_invalid_value
from testbench.errors import BenchError, InputError
from testbench.plant.true_arms import FAMILY_TRUE_ARMS, true_arm_of_seed
from testbench.report.badge import Badge, decide
from testbench.report.markdown import counted
from testbench.report.schema import ALIKE, true_arm_label
from testbench.report.table import Row, finite
from testbench.runs.manifest import Finished
from testbench.runs.spread import (
    SAME_ERROR,
    Number,
    Spread,
    ends,
    median_interval,
    middle,
    spread,
    triple,
    wins,
)
from testbench.runs.store import WHOLE

KINDS = {
    "workspace": "over the workspace, against the truth",
    "check_true": "at the check poses, against the truth",
    "check": "at the check poses, against readings",
    "identification": "at the fitted poses, against readings",
}
"""Errors of models, what matters most first, and where they are."""
MAX_ERROR_MM = 1e9  #: Largest error of a model.
ENDS = ("median", "p05", "p95")  #: Of a spread, what a report must have.
SPREADS = TypeAdapter(Spread)
OWN = ("said", "tables", "badge", "models", "seed")  #: Keys of report.json that are no single numbers.
CLOCK = ("seconds", "_s", "_ms")  #: Ends of keys of what a clock measured: it differs in any case.
MODEL = "name", "structure", "constraint", "prior", "method"  #: What tells how a model is drawn.
MIN_PAIRS = 2  #: Pairs that have a spread.

Verdict = Literal["same", "tie", "smaller", "larger"]
"""Of the second number beside the first one; a tie is within 2 %, or where its interval holds both."""
BySeed = Mapping[int, float]
ALONE: BySeed = {}  #: Of a run of one seed.


def models_of(run: Finished) -> dict[str, Row]:
    """Read the models of a report by name, with RMS errors by kind; none if several have one name.

    Raises:
        InputError: When an error is none that a model can have.
    """
    listed = run.report.get("models")
    rows = [own for own in listed if isinstance(own, dict)] if isinstance(listed, list) else []
    found = [_model(run, own) for own in rows if isinstance(own.get("name"), str)]
    told = [m for m in found if m.errors and not (m.constraint == "free" and m.conservative is False)]
    return {m.name: m for m in told} if len({m.name for m in told}) == len(told) else {}


def _model(run: Finished, own: Mapping[str, Any]) -> Row:
    errors = {}
    for kind in KINDS:
        cell = own.get(kind)
        found = cell.get("rms_mm") if isinstance(cell, dict) else None
        if isinstance(found, float | int | dict):
            errors[kind] = _error(run, f"models: {own['name']}, {kind}", found)
    keys = ("name", "structure", "constraint", "prior", "method", "conservative")
    drawn = {key: str(own.get(key) or "none") for key in ("structure", "constraint")}
    return Row({key: own.get(key) for key in keys} | drawn, prior=bool(own.get("prior")), errors=errors)


def _error(run: Finished, place: str, found: float | Mapping[str, Any]) -> float | Spread:
    """Read an error or its spread [mm]; a missing end is NaN."""
    told = found if isinstance(found, Mapping) else dict.fromkeys(ENDS, found)
    missing = {key: math.nan for key in ENDS if told.get(key, 0) is None}
    try:
        read = SPREADS.validate_python({**told, **missing})
    except ValidationError as err:
        keys, _, problem = first_invalid_value(err)
        raise InputError(run.file, f"{place}, {'.'.join(map(str, keys))}", problem) from err
    if any(mm < 0 or mm > MAX_ERROR_MM for mm in triple(read)):
        raise InputError(run.file, place, f"expected an RMS error of 0 to {MAX_ERROR_MM:g} mm, got {found}")
    return read if isinstance(found, Mapping) else found


def models_compared(a: Finished, b: Finished) -> list[Row]:
    """Join every error of every model that both runs have, by kind, what matters most first.

    Args:
        a: A finished run.
        b: Another one.

    Returns:
        A row per model and kind of error.

    Raises:
        InputError: When the trials of a run are damaged.
    """
    ours, theirs = models_of(a), models_of(b)
    both = [name for name in ours if name in theirs]
    mine, other = (_trials(run) if both else {} for run in (a, b))
    rows = []
    for kind in KINDS:
        for name in both:
            x, y = (own[name].errors.get(kind) for own in (ours, theirs))
            if x is not None and y is not None:
                pair = (_seeds(t.get((name, kind), ()), n) for t, n in ((mine, x), (other, y)))
                model = {key: ours[name][key] for key in MODEL}
                rows.append(Row(model, kind=kind, **differ(x, y, *pair)))
    return rows


def leading(models: Sequence[Row], runs: Sequence[Finished]) -> Row | None:
    """Choose the model to judge the runs by: what all recommend, else that of least error in all.

    Args:
        models: Rows of `models_compared`.
        runs: The runs.

    Returns:
        The row of the model; None for none.
    """
    pairs = [m for m in models if m.kind == models[0].kind]
    recommended = {str(run.report.get("recommended")) for run in runs}
    agreed = [p for p in pairs if {p.name} == recommended]
    known = [p for p in pairs if min(middle(p.a), middle(p.b)) > 0]
    least = sorted(known, key=lambda p: middle(p.a) * middle(p.b))
    return next(iter([*agreed, *least, *pairs]), None)


def differ(a: Number, b: Number, ours: BySeed = ALONE, theirs: BySeed = ALONE) -> Row:
    """Compare a number of two runs: its sizes, ratio b over a, verdict, and what tells.

    By "pairs" tell ratios seed by seed, where both runs have it above 0 in the same two seeds or more; by
    "spreads" whether these overlap; by "one" nothing, as a side has one number.

    Args:
        a: Number of the first run.
        b: Number of the second run.
        ours: The first run's by seed.
        theirs: The second run's by seed.

    Returns:
        The row.
    """
    first, second = middle(a), middle(b)
    difference = finite(second - first)
    ratios = [finite(theirs[s] / x) if x > 0 else None for s, x in ours.items() if s in theirs]
    known = [ratio for ratio in ratios if ratio is not None and ratio > 0]
    if ours.keys() == theirs.keys() and len(ratios) >= MIN_PAIRS and len(known) == len(ratios):
        times = spread(known)
        x, y = ([own[seed] for seed in ours] for own in (ours, theirs))
        told = {"by": "pairs", "pairs": len(x), "smaller": wins(y, x), "larger": wins(x, y)}
        told["interval"] = median_interval(np.array(known))
        return Row(a=a, b=b, difference=difference, ratio=times, verdict=_paired(times, known), **told)
    by = "spreads" if isinstance(a, Spread) and isinstance(b, Spread) else "one"
    ratio = finite(second / first) if first > 0 else None
    return Row(a=a, b=b, difference=difference, ratio=ratio, verdict=_verdict(a, b), by=by)


def _paired(ratio: Spread, ratios: Sequence[float]) -> Verdict:
    if np.allclose(triple(ratio), 1, rtol=0, atol=SAME_ERROR):
        return "same"
    low, high = ratio.ends
    within = median_interval(np.array(ratios)) or (low, high)
    if within[0] <= 1 <= within[1] or max(abs(low - 1), abs(high - 1)) <= ALIKE:
        return "tie"
    return "smaller" if ratio.median < 1 else "larger"


def _verdict(a: Number, b: Number) -> Verdict:
    (low, high), (least, most) = ends(a), ends(b)
    if np.allclose(triple(a), triple(b), rtol=SAME_ERROR, atol=0, equal_nan=True):
        return "same"
    if (low <= most and least <= high) or size(a, b) < math.log1p(ALIKE):
        return "tie"
    return "smaller" if middle(b) < middle(a) else "larger"


def size(a: Number, b: Number) -> float:
    """Measure how far two numbers are from equal, the same both ways: |log(b / a)|, inf if signs differ.

    Args:
        a: A number.
        b: Another one.

    Returns:
        The distance [1].
    """
    first, second = middle(a), middle(b)
    if first == second:
        return 0.0
    return abs(math.log(second / first)) if first * second > 0 else math.inf


def badge_of(lead: Row, a: Finished, b: Finished) -> Badge:
    """Judge the second run beside the first by the model that matters, by seed if both have the same.

    Args:
        lead: Row of the model.
        a: The first run.
        b: The second run.

    Returns:
        The badge.
    """
    x, y = (
        _seeds(_trials(run).get((lead.name, lead.kind), ()), reported)
        for run, reported in ((a, lead.a), (b, lead.b))
    )
    if not x or x.keys() != y.keys():
        x, y = ({0: middle(own)} for own in (lead.a, lead.b))
    each = "trial" if x.keys() == y.keys() and len(x) > 1 else "pair of runs"
    return decide(("B", [y[seed] for seed in x]), ("A", [*x.values()]), each)


def _trials(run: Finished) -> Mapping[tuple[str, str], Sequence[BySeed]]:
    """Read errors by seed of a run that left its trials, of every condition, by model and kind."""
    path = run.folder / WHOLE
    if not run.several or not path.is_file():
        return {}
    from testbench.runs.store import series  # here: few runs have trials

    return series(path, {kind: f"{kind}.rms_mm" for kind in KINDS})


def _seeds(conditions: Sequence[BySeed], reported: Number) -> BySeed:
    """Find the condition whose median is the report's; nothing if none is."""
    medians = [float(np.median([*own.values()])) for own in conditions]
    fits = np.isclose(medians, middle(reported), rtol=SAME_ERROR, atol=0)
    return next((own for own, fit in zip(conditions, fits, strict=True) if fit), {})


def numbers_compared(a: Finished, b: Finished) -> list[Row]:
    """Compare every single number of two reports that has the same keys; models and lists have their own.

    Args:
        a: The first run.
        b: The second run.

    Returns:
        A row per number.
    """
    ours, theirs = (dict(leaves({k: x for k, x in run.report.items() if k not in OWN})) for run in (a, b))
    rows = []
    for key in (key for key in ours if key in theirs and not key.endswith(CLOCK)):
        x, y = ours[key], theirs[key]
        if all(isinstance(own, int | float) and not isinstance(own, bool) for own in (x, y)):
            rows.append(Row(what=key.replace("_", " "), **differ(float(x), float(y))))
    return sorted(rows, key=lambda row: -size(row.a, row.b))


def leaves(value: object, key: str = "") -> Iterator[tuple[str, Any]]:
    """Walk nested tables to their leaves, with their keys joined by dots; lists are leaves.

    Args:
        value: The table.
        key: Key before every other.

    Yields:
        Key and value of a leaf.
    """
    if not isinstance(value, dict):
        yield key, value
        return
    for name, own in value.items():
        yield from leaves(own, f"{key}.{name}" if key else str(name))


# --- Inputs of two runs -------------------------------------------------------------------------------------

MAX_INPUT_LENGTH = 60  #: Letters of an input.
VIEWS = (".md", ".html", ".png", ".rrd", "manifest.json", "report.json", "run.log")
"""Ends of files in the folder of a model that only show it."""


def seeds(run: Finished) -> str:
    """Name the seeds of a run."""
    first, count = run.manifest.seed, run.manifest.seeds
    return "none" if not count else str(first) if count == 1 else f"{first} to {first + count - 1}"


def inputs_differ(a: Finished, b: Finished) -> list[Row]:
    """List the entries of two manifests that differ: settings, arms, data, seeds, versions, commit.

    Settings that one of two commands does not have say nothing: they are counted.

    Args:
        a: A finished run.
        b: Another one.

    Returns:
        A row per entry.
    """
    ours, theirs = _inputs(a), _inputs(b)
    keys = [key for key in dict.fromkeys([*ours, *theirs]) if ours.get(key) != theirs.get(key)]
    alone = [key for key in keys if key.startswith("settings.") and (key in ours) != (key in theirs)]
    alone = alone if ours["command"] != theirs["command"] else []
    rows = [
        Row(what=key, a=ours.get(key, "none"), b=theirs.get(key, "none")) for key in keys if key not in alone
    ]
    if alone:
        counts = (str(len([key for key in alone if key in own])) for own in (ours, theirs))
        rows.append(
            Row(what="number of settings that only one run has", **dict(zip("ab", counts, strict=True)))
        )
    return rows


def _inputs(run: Finished) -> dict[str, str]:
    """Flatten a manifest; files of arms count in their order, whatever their folders are called."""
    m = run.manifest
    arms = {
        f"arm {k}": {"folder": name, **{f: sha for f, sha in own.items() if not f.endswith(VIEWS)}}
        for k, (name, own) in enumerate(m.models.items(), 1)
    }
    whole = {"command": m.command, "settings": m.scenario, "seeds": seeds(run), **arms}
    whole |= {"version": m.versions, "commit": m.git}
    return {key: _input_words(value)[:MAX_INPUT_LENGTH] for key, value in leaves(whole)}


def _input_words(value: object) -> str:
    """Write an input for people: a list with commas, a setting without a value as "not set"."""
    if isinstance(value, list):
        return ", ".join(map(_input_words, value)) or "none"
    return "not set" if value is None else json.dumps(value).strip('"')


def refuse_unlike(runs: Sequence[Finished]) -> None:
    """Refuse runs of other true arms, or one seed beside several: which errs less then says nothing.

    Raises:
        BenchError: Names the arms, or the seeds.
    """
    counts = {run.manifest.seeds for run in runs if run.manifest.seeds}
    problem, known = "", [(run, arms) for run in runs if (arms := _true_arms(run))]
    alone = {run.manifest.seed for run, _ in known if run.manifest.seeds == 1}
    if 1 in counts and len(counts) > 1:
        told = " and ".join(f"{run.folder} with {counted(run.manifest.seeds, 'seed')}" for run in runs)
        problem = f"one seed in both runs or several in both (one seed has no spread), got {told}"
    elif len({arms for _, arms in known}) > 1 or (len(alone) > 1 and len(known) > 1):
        told = "; ".join(
            f"{run.folder}: {', '.join(sorted(arms))}, seeds {seeds(run)}" for run, arms in known
        )
        problem = f"the same true arms (and the same seed, if each run has one), got {told}"
    if problem:
        raise BenchError(f"runs: expected {problem}; --anyway compares them")


def _true_arms(run: Finished) -> frozenset[str]:
    """Name the true arms that a simulated run has met; none if it names none."""
    manifest = run.manifest
    named = {leaf for key, leaf in leaves(manifest.scenario) if key.split(".")[-1] == "true_arm"}
    if len(named) != 1 or not isinstance(family := named.pop(), str) or not manifest.seeds:
        return frozenset()
    own = range(manifest.seed, manifest.seed + min(manifest.seeds, len(FAMILY_TRUE_ARMS)))
    return frozenset(true_arm_label(name) for name in (true_arm_of_seed(family, seed) for seed in own))

"""Models of two runs by their names: errors that both reports have, in pairs of seeds where they can."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from testbench.bench.compare_numbers import Difference, differ, differ_paired
from testbench.errors import InputError
from testbench.identify import Constraint
from testbench.output.finished import Finished
from testbench.trials.spread import SAME, Number, middle, triple
from testbench.trials.store import WHOLE

KINDS = {
    "workspace": "over the workspace, against the truth",
    "check_true": "at the check poses, against the truth",
    "check": "at the check poses, against readings",
    "identification": "at the fitted poses, against readings",
}
"""Errors, what matters most first, and where they are."""
MOST, LARGEST_MM = 1000, 1e9  #: Models that are compared, and their largest error.
FITTED = AliasChoices("identification", "fit")  #: Of `identify` the second one.


class Errors(BaseModel):
    """Errors somewhere."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    rms_mm: Number = None


class NamedModel(BaseModel):
    """A model of a report."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: str = Field(min_length=1, max_length=100)
    structure: str = ""
    constraint: Constraint | None = None
    prior: bool = False
    conservative: bool | float | None = None
    workspace: Errors | None = None
    check_true: Errors | None = None
    check: Errors | None = None
    identification: Errors | None = Field(default=None, validation_alias=FITTED)

    @property
    def errors(self) -> dict[str, Number]:
        """RMS errors by kind, those that are there [mm]."""
        found: dict[str, Errors | None] = {kind: getattr(self, kind) for kind in KINDS}
        return {k: own.rms_mm for k, own in found.items() if own is not None and own.rms_mm is not None}


@dataclass(frozen=True)
class ModelPair:
    """An error of one model in two runs."""

    name: str
    structure: str  #: Empty where a report does not say.
    constraint: Constraint | None
    prior: bool
    kind: str  #: Of `KINDS`.
    rms_mm: Difference


BySeed = Mapping[tuple[str, str], Sequence[Mapping[int, float]]]
"""Errors by seed, of every condition, by model and kind."""


def models_of(run: Finished) -> dict[str, NamedModel]:
    """Models with an error, by name; none where the report has none, or several of one name.

    Raises:
        InputError: When an error is none that a model can have.
    """
    listed = run.report.get("models")
    if not isinstance(listed, list) or len(listed) > MOST:
        return {}
    try:
        models = [NamedModel.model_validate(one) for one in listed]
    except ValidationError:  # models of another kind of study
        return {}
    for model in models:
        _check(run, model)
    told = [m for m in models if m.errors and not (m.constraint == "free" and m.conservative is False)]
    return {m.name: m for m in told} if len({m.name for m in told}) == len(told) else {}


def _check(run: Finished, model: NamedModel) -> None:
    for kind, error in model.errors.items():
        if not 0 <= min(triple(error)) <= max(triple(error)) <= LARGEST_MM:
            problem = f"expected an RMS error of 0 to {LARGEST_MM:g} mm, got {error}"
            raise InputError(run.file, f"models: {model.name}, {kind}", problem)


def trials_of(run: Finished) -> BySeed:
    """Errors by seed of a run of several seeds that left its trials.

    Raises:
        InputError: When the trials are damaged.
    """
    path = run.folder / WHOLE
    if not run.several or not path.is_file():
        return {}
    from testbench.trials.stored import series  # here: importing Arrow takes 0.2 s

    found: dict[tuple[str, str], list[Mapping[int, float]]] = {}
    for own in series(path, [f"{kind}.rms_mm" for kind in KINDS]):
        found.setdefault((own.name, own.key.removesuffix(".rms_mm")), []).append(own.by_seed)
    return found


def compare_models(a: Finished, b: Finished) -> list[ModelPair]:
    """Every error of every model that both runs have, by kind, what matters most first.

    Raises:
        InputError: When the trials of a run are damaged.
    """
    ours, theirs = models_of(a), models_of(b)
    both = [name for name in ours if name in theirs]
    if not both:
        return []
    mine, other = trials_of(a), trials_of(b)
    found = []
    for kind in KINDS:
        for name in both:
            x, y = ours[name].errors.get(kind), theirs[name].errors.get(kind)
            if x is None or y is None:
                continue
            one, two = (_seeds_of(t.get((name, kind), ()), n) for t, n in ((mine, x), (other, y)))
            own = differ_paired(x, y, one, two) if one and two else differ(x, y)
            model = ours[name]
            found.append(ModelPair(name, model.structure, model.constraint, model.prior, kind, own))
    return found


def _seeds_of(conditions: Sequence[Mapping[int, float]], reported: Number) -> Mapping[int, float]:
    """The condition whose median is the report's; nothing where none is."""
    medians = [float(np.median([*own.values()])) for own in conditions]
    fits = np.isclose(medians, middle(reported), rtol=SAME, atol=0)
    return next((own for own, fit in zip(conditions, fits, strict=True) if fit), {})


def leading(pairs: Sequence[ModelPair], runs: Sequence[Finished]) -> ModelPair | None:
    """The model to judge the runs by: what all recommend, else the one of least error in all of them.

    Args:
        pairs: Of one kind of error.
        runs: Of these pairs.
    """
    recommended = {str(run.report.get("recommended")) for run in runs}
    agreed = [p for p in pairs if {p.name} == recommended]
    known = [p for p in pairs if min(middle(p.rms_mm.a), middle(p.rms_mm.b)) > 0]
    least = sorted(known, key=lambda p: middle(p.rms_mm.a) * middle(p.rms_mm.b))
    return next(iter([*agreed, *least, *pairs]), None)

"""Runs compared: their inputs, their models by name, and every number of their tables."""

from collections.abc import Sequence

from testbench.bench.compare_inputs import inputs_differ, seeds_words
from testbench.bench.compare_map import maps_of
from testbench.bench.compare_models import ModelPair, compare_models, leading, models_of
from testbench.bench.compare_report import Beside, ComparedReport, Counts, RunRow, letters
from testbench.errors import BenchError, InputError
from testbench.output.finished import Finished
from testbench.studies.stored import Stored, numbers_of, stored
from testbench.views.compared.numbers import Numbers, numbers
from testbench.views.markdown import as_plain

NAME = "compare"
NONE = Numbers([], Counts())
Read = Stored | InputError | None
"""What a run found, or why its report is not one of this version; None where its command has no tables."""


def compare(runs: Sequence[Finished]) -> ComparedReport:
    """Every run beside the first one.

    Raises:
        BenchError: When two runs have nothing in common.
        InputError: When a report, or what a run left of its trials, is damaged.
    """
    found, names = [_read(run) for run in runs], letters(len(runs))
    every = list(zip(names, runs, found, strict=True))
    rows = [_row(letter, run, own) for letter, run, own in every]
    beside = [_beside(every[0], other) for other in every[1:]]
    maps = maps_of(runs, names, beside[0].lead_name)
    return ComparedReport(NAME, rows, inputs_differ(runs), beside, [own.worst for own in maps])


def _read(run: Finished) -> Read:
    try:
        return stored(run)
    except InputError as err:
        return err


def _row(letter: str, run: Finished, found: Read) -> RunRow:
    answer = ""
    if isinstance(found, Stored):
        with numbers_of(run.file):
            answer = as_plain(found.words.block("answer"))
    return RunRow(letter, str(run.folder), run.manifest.command, seeds_words(run), answer)


def _beside(first: tuple[str, Finished, Read], other: tuple[str, Finished, Read]) -> Beside:
    (a, ours, one), (b, theirs, two) = first, other
    models = compare_models(ours, theirs)
    lead = leading([pair for pair in models if pair.kind == models[0].kind], [ours, theirs])
    named = [models_of(run) for run in (ours, theirs)]
    unread, found = "", NONE
    problem = next((own for own in (one, two) if isinstance(own, InputError)), None)
    if problem is not None and lead is None:
        raise problem
    if problem is not None:
        unread = str(problem)
    elif ours.manifest.command == theirs.manifest.command:
        found = _numbers(first, other, models)
    if lead is None and not found.counts.every:
        kinds = f"{a} is of {ours.manifest.command}, {b} of {theirs.manifest.command}"
        raise BenchError(f"{kinds}: no models by name in both, and no tables of one kind: nothing to compare")
    return Beside(
        a=a,
        b=b,
        models=models,
        lead=lead,
        only=[[name for name in x if name not in y] for x, y in (named, named[::-1])] if lead else [[], []],
        numbers=found.farthest,
        counts=found.counts,
        unread=unread,
        equal=ours.digest == theirs.digest,
    )


def _numbers(
    first: tuple[str, Finished, Read], other: tuple[str, Finished, Read], models: Sequence[ModelPair]
) -> Numbers:
    """The numbers of the tables but for those of models."""
    (_, _, one), (_, theirs, two) = first, other
    if not isinstance(one, Stored) or not isinstance(two, Stored):
        return NONE
    told = {(pair.name, pair.rms_mm.a, pair.rms_mm.b) for pair in models}
    with numbers_of(theirs.file):
        return numbers(one.tables, two.tables, told)

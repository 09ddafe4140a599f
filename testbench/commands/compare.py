"""What `testbench compare` says and draws of runs: which errs less, by how much, what they were given."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from testbench.commands.compare_inputs import NONE, inputs_differ, seeds_words
from testbench.commands.compare_rows import (
    KINDS,
    apart,
    badge_of,
    leading,
    models_compared,
    models_of,
    size,
    tables_compared,
    told,
)
from testbench.errors import BenchError, InputError
from testbench.output.manifest import Finished
from testbench.report.leave import Asked, leave
from testbench.report.report import Report, lines, numbers_of, read_report, say
from testbench.report.table import Row
from testbench.trials.spread import Spread, middle, triple
from testbench.views.colours import GREY, Look, look
from testbench.views.gains import Gain, less
from testbench.views.markdown import Markdown, as_markdown, as_plain, counted, ended, listed
from testbench.views.scene import Seen
from testbench.views.schema import Column, Table

COMMAND = "testbench compare"  #: As manifest.json names it.
LETTERS = "ABCDEFGH"  #: What the runs are called, in the order in which they were named.
FEW, MANY = 8, 30  #: Rows of inputs and of numbers in a terminal, and on the page.
WIDE, LONG = 32, 40  #: Names of models and numbers in a terminal, and beside an axis [characters].
NAMED, ONLY = 3, 5  #: Inputs, and models of one run alone, that a sentence names.
TIMES = 1e-9, 1e9  #: Ratios that are said.
READING = Markdown(
    "Pairs: the same seeds in both runs, a ratio a seed; its median with 5 to 95 %, of fewer than 20 seeds "
    "the range, and beyond the spread where 1 lies outside. Spreads: intervals from 5 to 95 %, or ranges, "
    "that do not overlap. Numbers that a clock measured are left out."
)


def report(runs: Sequence[Finished]) -> Report:
    """Every run beside the first one.

    Raises:
        BenchError: When two runs have nothing in common.
        InputError: When a report, or what a run left of its trials, is damaged.
    """
    named = dict(zip(LETTERS, runs, strict=False))
    reports = {letter: _read(run) for letter, run in named.items()}
    beside = [_beside(named, reports, letter) for letter in list(named)[1:]]
    led, a = [pair for pair in beside if pair.lead], LETTERS[0]  # where a model judges both
    badges = [badge_of(pair.lead, (a, named[a]), (pair.b, named[pair.b])) for pair in led]
    f = Row(
        runs=[_run(letter, run, reports[letter]) for letter, run in named.items()],
        inputs=inputs_differ(runs),
        beside=beside,
    )
    tables = {"inputs": _inputs(f)}
    for pair in beside:
        tables[pair.b] = _models(pair)
        tables[f"{pair.b}_numbers"] = _numbers(pair)
    whole = not f.inputs and all(pair.same for pair in beside)
    every = listed(list(named))
    alike = f"Nothing differs between {every}, neither inputs nor numbers."
    answers = [say("{letter} says: {answer}", run) for run in f.runs if run.answer]
    return Report(
        scenario="compare",
        question=Markdown(f"Do {every} differ, and which errs less?"),
        title=as_markdown("; ".join(f"{run.letter}: {_made(run)}" for run in f.runs)),
        answer=Markdown(alike) if whole else lines(_judged(pair, alone=len(beside) == 1) for pair in beside),
        worst=_farthest(beside),
        claims=list(_claims(f)),
        numbers=f,
        tables={name: own for name, own in tables.items() if own.rows},
        body=[*(name for name, own in tables.items() if own.rows), READING, *answers],
        badge=max(badges, key=lambda own: own.factor or 0, default=None),
    )


def _read(run: Finished) -> Report | InputError:
    """The report of a run, or why it is not one of this version."""
    try:
        return read_report(run.file, dict(run.report))
    except InputError as err:
        return err


def _run(letter: str, run: Finished, own: Report | InputError) -> Row:
    answer, seeds = "" if isinstance(own, InputError) else as_plain(own.headline), seeds_words(run)
    folder, made = str(run.folder), run.manifest.command
    return Row(letter=letter, folder=folder, command=made, seeds=seeds, answer=answer)


def _made(run: Row) -> str:
    """Where a run is, and what made it."""
    seeds = "" if run.seeds == NONE else f", {'seeds' if ' ' in run.seeds else 'seed'} {run.seeds}"
    return f"{run.folder} ({run.command}{seeds})"


def _beside(named: Mapping[str, Finished], reports: Mapping[str, Report | InputError], b: str) -> Row:
    """A run beside the first one: models by name, numbers of their tables."""
    a = LETTERS[0]
    ours, theirs, one, two = named[a], named[b], reports[a], reports[b]
    models = models_compared(ours, theirs)
    lead = leading(models, [ours, theirs])
    numbers: list[Row] = []
    counts, unread = Row(every=0, same=0, beyond=0, unsure=0), ""
    if isinstance(one, Report) and isinstance(two, Report):
        with numbers_of(theirs.file):
            numbers, counts = tables_compared(one, two, models)
    else:
        [problem, *_] = [own for own in (one, two) if isinstance(own, InputError)]
        if lead is None:
            raise problem
        unread = str(problem)
    if lead is None and not counts.every:
        kinds = f"{a} is of {ours.manifest.command}, {b} of {theirs.manifest.command}"
        raise BenchError(f"{kinds}: no models by name in both, and no tables of one kind: nothing to compare")
    names = [models_of(run) for run in (ours, theirs)]
    equal = ours.digest == theirs.digest
    alike = counts.same == counts.every > 0 and all(m.verdict == "same" for m in models)
    return Row(
        a=a,
        b=b,
        models=models,
        lead=lead,
        only=[[n for n in x if n not in y] for x, y in (names, names[::-1])] if lead else [[], []],
        numbers=numbers,
        counts=counts,
        unread=unread,
        equal=equal,
        same=equal or alike,
    )


def _led(pair: Row) -> list[Row]:
    """Models by the kind of error that matters most."""
    return [own for own in pair.models if own.kind == pair.lead.kind] if pair.lead else []


def _better(pair: Row, row: Row) -> Markdown:
    """Which of two runs errs less, and by how much."""
    if not apart(row):
        return Markdown(f"No clear difference between {pair.a} and {pair.b}")
    ours, theirs = (pair.b, pair.a) if row.verdict == "less" else (pair.a, pair.b)
    if row.ratio is None or not TIMES[0] < middle(row.ratio) < TIMES[1]:
        return Markdown(f"{ours} errs less")
    times, inside = row.ratio, row.get("interval")
    if row.verdict == "less":
        inside = inside and (1 / inside[1], 1 / inside[0])
        value, low, high = triple(times)
        times = Spread(1 / value, 1 / high, 1 / low)
    gain = Gain(ours, theirs, None, None, times, row.get("pairs") or 1, inside)
    how = less(gain, "seed" if row.by == "pairs" else "")
    return Markdown(f"The error of {ours} is {how} than that of {theirs}")


def _judged(pair: Row, *, alone: bool) -> Markdown:
    """Two runs by the model that matters, or by all numbers of their tables; of several in short."""
    if pair.same or pair.lead is None:
        return _counted(pair)
    own, better = pair.lead, _better(pair, pair.lead)
    if not alone:
        return say(f"{better} ({{name}}{', no spread' if own.by == 'one' else ''}).", own)
    sizes = "{a:.3f} mm in {A}, {b:.3f} mm in {B}" if own.verdict != "same" else "{a:.3f} mm in both"
    return say(f"{better}. {{name}} {KINDS[own.kind]}: {sizes}.", own, A=pair.a, B=pair.b)


def _counted(pair: Row) -> Markdown:
    """How many numbers differ."""
    both, n = f"{pair.a} and {pair.b}", pair.counts
    if pair.same:
        return Markdown(f"No number differs between {both}.")
    every = counted(n.every, "number")
    if not n.beyond + n.unsure:
        return Markdown(
            f"No clear difference between {both}: of {every} none differs by more than its spread or 2 %."
        )
    apart = f"{n.beyond} by more than their spread, {n.unsure} by more than 2 % without one"
    return Markdown(f"{both} differ in {n.beyond + n.unsure} of {every}: {apart}.")


def _why(pair: Row) -> Markdown:
    """What tells that one errs less, or that nothing does."""
    own = pair.lead
    if own.by == "pairs":
        ahead = pair.b if own.smaller > own.larger else pair.a
        return Markdown(f"{ahead} errs less in {max(own.smaller, own.larger)} of {own.pairs} seeds.")
    if own.kind == "identification":
        return Markdown("Readings that were fitted tell nothing of other poses.")
    if own.by == "one":
        side = "on a side" if isinstance(own.a, Spread) or isinstance(own.b, Spread) else "each"
        return Markdown(f"One number {side}: no spread tells whether that is chance.")
    do = "overlap" if own.verdict == "tie" else "do not overlap"
    return Markdown(f"Their intervals over the seeds {do}.")


def _farthest(beside: Sequence[Row]) -> Markdown:
    """The model, or the number, that differs most, if the answer does not say it."""
    found = [(pair, own) for pair in beside for own in _led(pair) if apart(own)]
    if found:
        pair, own = max(found, key=lambda both: size(both[1].a, both[1].b))
        if len(beside) == 1 and own.name == pair.lead.name:
            return Markdown()
        return say("Farthest apart: {name}, {a:.3f} mm in {A}, {b:.3f} mm in {B}.", own, A=pair.a, B=pair.b)
    others = [(pair, pair.numbers[0]) for pair in beside if pair.numbers and not pair.lead]
    return lines(
        say(
            "Farthest apart: {what}, {shown_a} in {A}, {shown_b} in {B}.",
            own,
            what=_what(own),
            A=pair.a,
            B=pair.b,
        )
        for pair, own in others
    )


def _what(own: Row) -> str:
    return ", ".join(filter(None, [own.row, own.quantity]))


def _claims(f: Row) -> Iterator[Markdown]:
    [pair, *others] = f.beside
    if not others and pair.lead and not pair.same:
        yield _why(pair)
    names, more = [own.what for own in f.inputs], len(f.inputs) - NAMED
    if not names:
        yield Markdown("Inputs are the same: settings, arms, seeds, versions, commit.")
    elif more <= 0:
        yield say("Inputs differ: {text}.", text="; ".join(map(_input, f.inputs)))
    else:
        yield say("Inputs differ in {text} and {more} more.", text=", ".join(names[:NAMED]), more=more)
    if not others:
        yield from _of_models(pair)


def _of_models(pair: Row) -> Iterator[Markdown]:
    """How many models err less, and which are in one run alone."""
    if pair.lead and not pair.same:
        verdicts = [own.verdict for own in _led(pair)]
        ahead, behind = verdicts.count("less"), verdicts.count("more")
        yield Markdown(
            f"Of {counted(len(verdicts), 'model')} {ahead} err{'s' * (ahead == 1)} less in {pair.b}, "
            f"{behind} more, {len(verdicts) - ahead - behind} show no clear difference."
        )
    if only := [name for own in pair.only for name in own]:
        more = f"; and {len(only) - ONLY} more" if len(only) > ONLY else ""
        yield say("Not in both: {text}.", text="; ".join(only[:ONLY]) + more)
    if pair.unread and not pair.equal:
        yield say("Models alone are compared: {text}", text=ended(pair.unread))


def _input(row: Row) -> str:
    *first, last = row["values"]
    return f"{row.what} {', '.join(first)} and {last}{' ' if row.unit else ''}{row.unit}"


def _inputs(f: Row) -> Table:
    named = [Column(f"values.{k}", run.letter) for k, run in enumerate(f.runs)]
    rows = [Row(own, title=f"{own.what}, {own.unit}" if own.unit else own.what) for own in f.inputs[:MANY]]
    return Table((Column("title", "input"), *named), rows, "What differs in the inputs")


def _models(pair: Row, width: int = 0) -> Table:
    """Models by the error that matters most, by the other kinds their ratios; for a terminal of a width."""
    a, b, led = pair.a, pair.b, _led(pair)
    ratios = {(own.name, own.kind): own.ratio for own in pair.models}
    kinds = [] if width else list(dict.fromkeys(own.kind for own in pair.models))[1:]
    over, marked = f"{b} / {a}", _clipped(pair.lead.name, width) if pair.lead else ""
    head = (
        Column("name", "model"),
        Column("a", a, "mm"),
        Column("b", b, "mm"),
        Column("ratio", over, form=".2f", short=over),
        Column("told", f"{b} is"),
        *(Column(kind, f"{over} {KINDS[kind]}", form=".2f") for kind in kinds),
    )
    others = [{kind: ratios.get((own.name, kind)) for kind in kinds} for own in led]
    rows = [
        Row(own, name=_clipped(own.name, width), told=told(own), **more)
        for own, more in zip(led, others, strict=True)
    ]
    shades = {
        row.name: look(row.structure or "", row.constraint, bool(row.prior)) for row in rows if row.constraint
    }
    title = f"RMS error {KINDS[pair.lead.kind]}, {b} beside {a}" if pair.lead and not width else ""
    return Table(head, rows, title, marked, headline="ratio", looks=shades)


def _numbers(pair: Row, width: int = 0) -> Table:
    """Numbers that differ most, as the tables of their runs show them; for a terminal of a width a few."""
    a, b, n, shown = pair.a, pair.b, len(pair.numbers), "" if width else "shown_"
    head = (
        Column("what", "number"),
        Column(f"{shown}a", a, form=".4g", exact=True),
        Column(f"{shown}b", b, form=".4g", exact=True),
        Column("ratio", f"{b} / {a}", form=".3g", short=f"{b} / {a}"),
        Column("told", f"{b} is"),
    )
    rows = [
        Row(own, what=_clipped(_what(own), width) if width else f"{own.table}: {_what(own)}", told=told(own))
        for own in pair.numbers[: FEW if width else MANY]
    ]
    many, kind = f", {MANY} of {n}" if n > MANY else "", "Other errors" if pair.lead else "Numbers"
    title = "" if width else f"{kind} that differ most{many}, {b} beside {a}"
    shades = {row.what: Look(GREY, 0, prior=True) for row in rows}
    return Table(head, rows, title, headline="ratio", looks=shades)


def printed(said: Report) -> list[Table]:
    """What a terminal of 80 columns shows: the models, or the numbers, of every run beside A."""
    pairs = [own for own in said.numbers["beside"] if not own.same and (own.lead or own.numbers)]
    return [_models(pair, WIDE) if pair.lead else _numbers(pair, WIDE) for pair in pairs]


def input_lines(said: Report) -> list[str]:
    """Inputs that differ where no sentence says them, for a terminal: of any length, no column holds them."""
    rows, letters = said.numbers["inputs"], [run.letter for run in said.numbers["runs"]]
    if len(rows) <= NAMED:
        return []
    found = [
        f"{row.what}{', ' if row.unit else ''}{row.unit}: "
        + "; ".join(f"{a} {value}" for a, value in zip(letters, row["values"], strict=True))
        for row in rows[:FEW]
    ]
    more = len(rows) - len(found)
    return [*found, f"and {more} more in report.md"] if more else found


def _clipped(text: str, width: int) -> str:
    return text if len(text) <= (width or len(text)) else f"{text[: width - 3]}..."


def write(runs: Sequence[Finished], said: Report, out: Path) -> None:
    """Numbers, words, picture, page, recording and manifest.json; InputError when they cannot be written."""
    named = zip(said.numbers["runs"], runs, strict=True)
    flags = {row.letter: {row.folder: run.digest} for row, run in named}
    tables = [
        own for pair in said.numbers["beside"] for own in (_models(pair), _numbers(pair, LONG)) if own.rows
    ]
    leave(out, Asked(COMMAND, "runs", flags, [], "compare.png"), said, Seen(tables=tables))

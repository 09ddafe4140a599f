"""The tables and words of a comparison, for terminal, report.md and recording."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from testbench.bench.compare_models import KINDS, ModelPair
from testbench.bench.compare_numbers import Difference
from testbench.bench.compare_report import Beside, ComparedReport, NumberPair
from testbench.trials.gain import Gain
from testbench.trials.spread import Spread, middle, triple
from testbench.views.colours import Look, look
from testbench.views.gains import less
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table

FEW, MANY = 8, 30  #: Rows of inputs and of numbers in a terminal, and on the page.
WIDE, NAME = 30, 28  #: Names of numbers and of models in a terminal [characters].
NAMED = 3  #: Inputs that a sentence names.


def told(found: Difference) -> str:
    """What the second number is beside the first one."""
    if found.verdict == "same":
        return "the same"
    if found.verdict == "alike":
        return "within 2 %" if found.near else "within the spread"
    sizes = ("smaller", "larger") if min(*triple(found.a), *triple(found.b)) >= 0 else ("lower", "higher")
    size = sizes[found.verdict == "more"]
    return f"{size}, no spread" if found.by == "one" else size


def tables(report: ComparedReport) -> dict[str, Table]:
    """Every table by its name: inputs, and of every run beside the first one models by error and numbers."""
    found = {
        "inputs": _inputs(report),
        "overview": Table(OVERVIEW, [_in_short(pair) for pair in report.beside]),
    }
    for pair in report.beside:
        for where, models in pair.by_kind.items():
            found[f"{pair.b}, {where}"] = models_table(pair, models, f"RMS error {where}")
        found[f"{pair.b}, numbers"] = _numbers(pair, pair.numbers[:MANY], None)
    return found


def printed(report: ComparedReport) -> list[Table]:
    """What a terminal of 80 columns shows: the models, or the numbers, of every run beside A."""
    found = [Table(OVERVIEW, [_in_short(pair) for pair in report.beside])] if len(report.beside) > 1 else []
    for pair in report.beside:
        if not pair.same and pair.lead:
            found.append(models_table(pair, pair.led))
        elif not pair.same:
            found.append(_numbers(pair, pair.numbers[:FEW], WIDE))
    return found


def sortable(report: ComparedReport) -> list[Table]:
    """Tables of the page, what matters most first."""
    every = tables(report)
    heads = [f"{pair.b}, {where}" for pair in report.beside for where in pair.by_kind]
    others = [f"{pair.b}, numbers" for pair in report.beside if pair.numbers]
    return [replace(every[name], title=every[name].title or "Other numbers") for name in heads + others]


def gain(pair: Beside, found: Difference) -> Gain | None:
    """The run that errs less beside the other one; None where they are alike, or an error is not above 0."""
    if not found.apart or found.ratio is None or middle(found.ratio) <= 0:
        return None
    if found.verdict == "more":
        return Gain(pair.a, pair.b, found.a, found.b, found.ratio, found.pairs or 1)
    middle_, low, high = triple(found.ratio)
    times = Spread(1 / middle_, 1 / high, 1 / low)
    return Gain(pair.b, pair.a, found.b, found.a, times, found.pairs or 1)


OVERVIEW = (
    Column("b", "run"),
    Column("lead", "model"),
    Column("ratio", "error over that of A", form=".2f", short="error\nover\nthat of A"),
    Column("told", "it is"),
    Column("less", "models that err less", form="d", short="models\nthat err\nless"),
    Column("more", "more", form="d"),
    Column("alike", "alike", form="d"),
)


def _in_short(pair: Beside) -> dict[str, object]:
    lead = pair.lead and pair.lead.rms_mm
    counts = {"less": pair.count("less"), "more": pair.count("more"), "alike": pair.count("alike", "same")}
    said = {"lead": pair.lead.name, "ratio": lead.ratio, "told": told(lead)} if pair.lead and lead else {}
    return {"b": pair.b, **said, **counts}


def input_lines(report: ComparedReport) -> list[str]:
    """Inputs that differ where no sentence says them, for a terminal: of any length, no column holds them."""
    if len(report.inputs) <= NAMED:
        return []
    letters = [run.letter for run in report.runs]
    found = [
        f"{row.title}: " + "; ".join(f"{a} {value}" for a, value in zip(letters, row.values, strict=True))
        for row in report.inputs[:FEW]
    ]
    more = len(report.inputs) - len(found)
    return [*found, f"and {more} more in report.md"] if more else found


def models_table(pair: Beside, models: Sequence[ModelPair], title: str = "") -> Table:
    """Models of two runs by one kind of error, the leading one marked; without a title for a terminal."""
    a, b = pair.a, pair.b
    columns = (
        Column("name", "model"),
        Column("a", a, "mm"),
        Column("b", b, "mm"),
        Column("difference", f"{b} - {a}", "mm", "+.3f", short=f"{b} - {a}\nmm"),
        Column("ratio", f"{b} / {a}", form=".2f", short=f"{b} / {a}"),
        Column("told", f"{b} is"),
    )
    names = [model.name if title else _clipped(model.name, NAME) for model in models]
    rows = [
        {"name": name, "told": told(model.rms_mm), **vars(model.rms_mm)}
        for name, model in zip(names, models, strict=True)
    ]
    marked = next((name for name, m in zip(names, models, strict=True) if m.name == pair.lead_name), "")
    return Table(columns, rows, title, marked, headline="ratio", looks=_looks(models, names))


def model_row(report: ComparedReport, name: str) -> Table:
    """A model in all runs: a row a kind of error, medians."""
    first = report.beside[0]
    told_of = {pair.b: {m.kind: m.rms_mm for m in pair.models if m.name == name} for pair in report.beside}
    columns = [Column("where", "RMS error"), Column(first.a, first.a, "mm", exact=True)]
    columns += [Column(letter, letter, "mm", exact=True) for letter in told_of]
    columns += [Column(f"{letter} is", f"{letter} is") for letter in told_of]
    rows = [
        {"where": KINDS[kind], first.a: found.a}
        | {letter: own[kind].b for letter, own in told_of.items() if kind in own}
        | {f"{letter} is": told(own[kind]) for letter, own in told_of.items() if kind in own}
        for kind, found in told_of[first.b].items()
    ]
    return Table(tuple(columns), rows)


def _inputs(report: ComparedReport) -> Table:
    columns = (
        Column("title", "input"),
        *(Column(f"values.{k}", r.letter) for k, r in enumerate(report.runs)),
    )
    return Table(columns, report.inputs[:MANY])


def _numbers(pair: Beside, numbers: Sequence[NumberPair], width: int | None) -> Table:
    """Numbers as the tables of their runs show them; in a terminal's width their medians."""
    columns = (
        Column("what", "number"),
        Column("a", pair.a, form=".4g", exact=True),
        Column("b", pair.b, form=".4g", exact=True),
        Column("ratio", f"{pair.b} / {pair.a}", form=".3g", short=f"{pair.b} / {pair.a}"),
        Column("told", f"{pair.b} is"),
    )
    rows = [
        {
            "what": _clipped(own.what, width) if width else f"{own.table}: {own.what}",
            "a": own.found.a if width else own.a,
            "b": own.found.b if width else own.b,
            "ratio": own.found.ratio,
            "told": told(own.found),
        }
        for own in numbers
    ]
    return Table(columns, rows)


def _clipped(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _looks(models: Sequence[ModelPair], names: Sequence[str]) -> dict[str, Look]:
    """How models are drawn of which a report says what they are."""
    pairs = zip(names, models, strict=True)
    return {name: look(m.structure, m.constraint, m.prior) for name, m in pairs if m.constraint is not None}


def words(report: ComparedReport) -> Words:
    """The words of a comparison."""
    values = {"report": report, "tables": tables(report), "named": NAMED, "many": MANY}
    return Words(Path(__file__).parent, values | {"told": told, "gain": gain, "less": less}, "compared.md.j2")

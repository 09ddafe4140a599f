"""The tables and words of a comparison, for terminal, report.md and recording."""

from collections.abc import Sequence
from pathlib import Path

from testbench.bench.compare_models import ModelPair
from testbench.bench.compare_numbers import Difference
from testbench.bench.compare_report import Beside, ComparedReport, NumberPair
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table

FEW, MANY = 8, 60  #: Rows of inputs and of numbers in a terminal, and on the page.
WIDE = 40  #: Words in a row of a terminal [characters].
NAMED = 3  #: Inputs that a sentence names.


def told(found: Difference) -> str:
    """What the second number is beside the first one."""
    if found.verdict == "same":
        return "the same"
    if found.verdict == "alike":
        return "within 2 %" if found.by == "one" else "within the spread"
    size = "smaller" if found.verdict == "less" else "larger"
    return f"{size}, no spread" if found.by == "one" else size


def tables(report: ComparedReport) -> dict[str, Table]:
    """Every table by its name: inputs, and of every run beside the first one models by error and numbers."""
    found = {
        "inputs": _inputs(report, MANY),
        "inputs_short": _inputs(report, FEW),
        "overview": Table(OVERVIEW, [_in_short(pair) for pair in report.beside]),
    }
    for pair in report.beside:
        for where, models in pair.by_kind.items():
            title = f"RMS error {where}"
            found[f"{pair.b}, {where}"] = models_table(pair, models, title if pair.lead else "")
        found[f"{pair.b}, numbers"] = _numbers(pair, pair.numbers[:MANY], None)
        found[f"{pair.b}, numbers_short"] = _numbers(pair, pair.numbers[:FEW], WIDE)
    return found


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


def models_table(pair: Beside, models: Sequence[ModelPair], title: str) -> Table:
    """Models of two runs by one kind of error; the leading one is marked."""
    columns = (Column("name", "model"), *_columns(pair, "mm", "+.3f"))
    rows = [{"name": model.name, "told": told(model.rms_mm), **vars(model.rms_mm)} for model in models]
    return Table(columns, rows, title, pair.lead.name if pair.lead else "")


def _columns(pair: Beside, unit: str, signed: str) -> tuple[Column, ...]:
    a, b = pair.a, pair.b
    return (
        Column("a", a, unit),
        Column("b", b, unit),
        Column("difference", f"{b} - {a}", unit, signed, short=f"{b} - {a}\n{unit}"),
        Column("ratio", f"{b} / {a}", form=".2f", short=f"{b} / {a}"),
        Column("told", f"{b} is"),
    )


def _inputs(report: ComparedReport, most: int) -> Table:
    columns = (Column("what", "input"), *(Column(f"values.{k}", r.letter) for k, r in enumerate(report.runs)))
    return Table(columns, report.inputs[:most])


def _numbers(pair: Beside, numbers: Sequence[NumberPair], width: int | None) -> Table:
    """Numbers as the tables of their runs show them."""
    a, b = pair.a, pair.b
    columns = (
        Column("what", "number"),
        Column("a", a),
        Column("b", b),
        Column("ratio", f"{b} / {a}", form=".3g", short=f"{b} / {a}"),
        Column("told", f"{b} is"),
    )
    rows = [
        {
            "what": _clipped(own.what, width) if width else f"{own.table}: {own.what}",
            "a": own.a,
            "b": own.b,
            "ratio": own.found.ratio,
            "told": told(own.found),
        }
        for own in numbers
    ]
    return Table(columns, rows)


def _clipped(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."


def words(report: ComparedReport) -> Words:
    """The words of a comparison."""
    values = {"report": report, "tables": tables(report), "told": told, "named": NAMED, "many": MANY}
    return Words(Path(__file__).parent, values, "compared.md.j2")

"""The columns of the study of wrong inputs, and its tables."""

from testbench.studies.wrong_inputs.report import WrongInputsReport
from testbench.views.schema import Column, Table


def _percent(key: str, heading: str) -> Column:
    return Column(key, heading, "%", ".1f", scale=100)


WORDS = Column("words", "fault")
RIGHT = _percent("right.share", "right first")
OTHER = _percent("other", "another first")
SILENT = _percent("silent", "not noticed")
BEFORE = _percent("before", "noticed by the two checks before")
FAULTS = (
    WORDS,
    Column("names", "right doubt"),
    Column("right.of", "sets", form="d"),
    RIGHT,
    _percent("right.low", "from"),
    _percent("right.high", "to"),
    _percent("anywhere", "right anywhere"),
    OTHER,
    SILENT,
    Column("instead", "instead"),
    BEFORE,
)
KINDS = (
    Column("kind", "data sets"),
    Column("alarms.of", "sound", form="d"),
    _percent("alarms.share", "doubted"),
    _percent("alarms.high", "at most"),
    Column("right.of", "faults", form="d"),
    RIGHT,
    _percent("right.low", "at least"),
)
ALARMS = (
    Column("trial", "trial", form="d"),
    Column("kind", "data set"),
    Column("first", "doubt"),
    Column("evidence", "evidence, nats", form=".0f"),
    Column("said", "what was said"),
)
EXAMPLES = (
    Column("words", "planted"),
    Column("first", "first doubt"),
    Column("said", "what was said"),
    Column("right", "right", form="yes"),
)


def tables(report: WrongInputsReport) -> dict[str, Table]:
    """By fault, by kind of data set, false alarms, and one trial."""
    return {
        "faults": Table(FAULTS, report.faults),
        "kinds": Table(
            KINDS, report.kinds, "sound data sets doubted, and faults named right first", headline=RIGHT.key
        ),
        "alarms": Table(ALARMS, report.false_alarms),
        "examples": Table(EXAMPLES, report.examples),
    }

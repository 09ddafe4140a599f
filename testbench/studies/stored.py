"""A report read back from report.json, if it is of this version: its tables and words serve again."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import JsonValue, TypeAdapter, ValidationError

from testbench.bench.absolute_report import AbsoluteReport
from testbench.errors import InputError
from testbench.output.finished import Finished, read_plain, told_as
from testbench.report.report import Report, read
from testbench.report.table import rows
from testbench.views.absolute import words as absolute
from testbench.views.markdown import Words
from testbench.views.schema import Table

C = TypeVar("C")


@dataclass(frozen=True)
class Stored:
    """What a run found."""

    report: object
    tables: Mapping[str, Table]
    words: Words | Report


@dataclass(frozen=True)
class Kind(Generic[C]):
    """A command's report."""

    report: type[C]
    tables: Callable[[C], Mapping[str, Table]]
    words: Callable[[C], Words]

    def read(self, file: Path, plain: JsonValue) -> Stored:
        """The report of these data; InputError where they are none."""
        report = typed(self.report, file, plain)
        with numbers_of(file):
            return Stored(report, self.tables(report), self.words(report))


COMMANDS: Mapping[str, Callable[[Path, JsonValue], Stored]] = {
    "testbench calibrate": Kind(AbsoluteReport, absolute.tables, absolute.words).read,
}
"""Commands whose reports have tables of their own."""


def stored(run: Finished) -> Stored | None:
    """What a run found; None where its command has no tables of its own.

    Raises:
        InputError: When the report is not one of this version.
    """
    script, plain = run.manifest.command, dict(run.report)
    if "said" in plain or script.startswith("scenarios/"):
        return of_report(run.file, plain)
    return COMMANDS[script](run.file, plain) if script in COMMANDS else None


def read_report(folder: Path) -> Stored:
    """What a run of a study found, from the report.json in its folder.

    Raises:
        InputError: When there is none, or it is not one of this version.
    """
    file = folder / "report.json"
    return of_report(file, read_plain(file))


def of_report(file: Path, plain: JsonValue) -> Stored:
    """A report that holds its words and tables; InputError where it is none."""
    try:
        report = read(plain)  # type: ignore[arg-type]  # what is no table of keys raises
    except KeyError as err:
        raise InputError(file, str(err).strip("'"), "not a report of this version: expected it") from err
    except (TypeError, ValueError, AttributeError, LookupError) as err:
        raise InputError(file, "", f"not a report of this version: {err}") from err
    with numbers_of(file):
        return Stored(rows(report.numbers), report.tables, report)


def typed(kind: type[C], file: Path, plain: JsonValue) -> C:
    """Plain data as a dataclass; InputError names the first place that is not of it."""
    try:
        return TypeAdapter(kind).validate_python(plain)
    except ValidationError as err:
        raise told_as(file, err, "not a report of this version: ") from err


@contextlib.contextmanager
def numbers_of(file: Path) -> Iterator[None]:
    """What words and tables cannot make of a stranger's numbers is told as an InputError of the file."""
    try:
        yield
    except InputError:
        raise
    except Exception as err:  # any: of the right types, and yet nothing that a run can find
        problem = f"its numbers do not belong together: {type(err).__name__}: {err}"
        raise InputError(file, "", problem) from err

"""A report read back from report.json, if it is of this version: its tables and words serve again."""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import JsonValue

from testbench.errors import InputError
from testbench.output.finished import Finished, read_plain
from testbench.report.report import Report, read
from testbench.report.table import rows
from testbench.views.schema import Table


@dataclass(frozen=True)
class Stored:
    """What a run found."""

    report: object
    tables: Mapping[str, Table]
    words: Report


def stored(run: Finished) -> Stored | None:
    """What a run found; None where its command has no tables of its own.

    Raises:
        InputError: When the report is not one of this version.
    """
    told = "said" in run.report or run.manifest.command.startswith("scenarios/")
    return of_report(run.file, dict(run.report)) if told else None


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

"""Frame of every command: libraries undisturbed, one line and an exit code for what the user can mend.

Matplotlib reads `matplotlibrc` of the working folder, which may be a stranger's: it says how large a picture
is, and which programs set its letters.
"""

import contextlib
import importlib
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from unicodedata import category

import numpy as np
import typer
from pydantic import ValidationError
from threadpoolctl import threadpool_limits
from typer.exceptions import TyperException

from testbench.arm.document import first_invalid_value
from testbench.errors import MAX_MESSAGE, BenchError, Interrupted, printable, shorten
from testbench.runs import interrupt
from testbench.runs.interrupt import INTERRUPTED

RECORDINGS = (
    "RERUN_FLUSH",
    "RERUN_CHUNK",
)  #: Begin the names of what cuts recordings otherwise; RERUN=off none.
SETTINGS = "matplotlibrc"
UNUSED = "char", "ctypeslib", "f2py", "ma", "polynomial", "rec", "testing"
"""Modules of numpy: scipy imports all that numpy names, and these take a tenth of a command's start."""


def undisturbed() -> None:
    """Have recordings and figures as they are meant, libraries' warnings unsaid; before any is imported.

    Warnings name lines of code, which are nothing for people at a terminal: `python -W` asks for them.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    for name in [name for name in os.environ if name == "RERUN" or name.startswith(RECORDINGS)]:
        del os.environ[name]
    os.environ["MPLBACKEND"] = "agg"
    os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"  # of any package that is installed beside this one
    os.environ["MUJOCO_GL"] = "disable"  # nothing is drawn by MuJoCo; a driver that lacks is an error
    np.__all__ = [name for name in np.__all__ if name not in UNUSED]
    getattr(np, "__numpy_submodules__", set()).difference_update(UNUSED)
    if os.path.lexists(SETTINGS):
        _import_elsewhere("matplotlib")


def _import_elsewhere(package: str) -> None:
    here = Path.cwd()
    os.chdir("/")
    try:
        importlib.import_module(package)
    finally:
        os.chdir(here)


WRONG = 2
GONE = 141  #: Nobody reads the output any more, as behind `head`: 128 + SIGPIPE.
UNFIT = "Cc", "Zl", "Zp"
"""Unicode's categories of control characters and ends of lines."""


def say(line: str) -> None:
    """Say a line on standard error, if anybody listens."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            sys.stderr.write(line)
            sys.stderr.flush()


def run(app: typer.Typer, fail: Callable[[str], object] = say) -> int:
    """Run a typer app on the command line's arguments.

    Args:
        app: The command.
        fail: Where the line about an error goes.

    Returns:
        0 when it went well, 2 for what the user can mend, 130 after Ctrl-C, 141 where nobody reads on,
        143 after SIGTERM.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # what its encoding cannot write is no reason to fail
    with interrupt.raised() as stopped:
        try:
            code, words = _outcome(app)
        except BaseException:
            if not stopped():
                raise
            code, words = INTERRUPTED, ""
        if code == INTERRUPTED or stopped():  # typer itself turns Ctrl-C into this code
            code, words = stopped() or INTERRUPTED, words or f"interrupted: {interrupt.RESULTS_KEPT}"
        if words:
            fail(shorten(printable(words), MAX_MESSAGE) + "\n")
        return code


def _outcome(app: typer.Typer) -> tuple[int, str]:
    """Exit code, and the line to say with it."""
    try:
        _check_words(sys.argv[1:])
        with threadpool_limits(1):  # several BLAS threads change result bits, and slow many processes down
            code = app(standalone_mode=False)
        _flush()
    except Interrupted as err:
        return INTERRUPTED, f"interrupted: {err}"
    except SystemExit:  # of typer and rich where a pipe is broken
        return GONE, ""
    except BenchError as err:
        return WRONG, f"error: {err}"
    except TyperException as err:
        return WRONG, f"error: {_wrong_word(err, sys.argv[1:])}; --help lists what there is"
    except ValidationError as err:
        keys, _, problem = first_invalid_value(err)
        return WRONG, f"error: {'.'.join(map(str, keys))} in SI units: {problem}"
    except OSError as err:
        _drop_output()
        place = err.filename or "standard output or another device"
        return WRONG, f"error: {place}: cannot be read or written: {err.strerror or err}"
    return code if isinstance(code, int) else 0, ""


def _check_words(words: Sequence[str]) -> None:
    """Refuse what no report can hold on a line: bytes of a name that are no text, and control characters."""
    for word in words:
        if any(category(c) in UNFIT for c in word):
            raise BenchError(
                f"expected no control characters on the command line, got {shorten(ascii(word), 80)}"
            )
        try:
            word.encode()
        except UnicodeEncodeError:
            raise BenchError(f"expected UTF-8 on the command line, got {os.fsencode(word)!r}") from None


def _wrong_word(err: TyperException, words: Sequence[str]) -> str:
    """What is wrong with a word of the command line: its flag, what was expected, what was got."""
    param = getattr(err, "param", None)
    problem = str(getattr(err, "message", "")).rstrip(".")
    if isinstance(err.__cause__, ValidationError):
        problem, _, _ = first_invalid_value(err.__cause__).problem.partition(", got ")
    for flag in getattr(param, "opts", ()):
        for k, word in enumerate(words):
            name, _, value = word.partition("=")
            if problem and name == flag and (value or words[k + 1 :]):
                got = repr(value or words[k + 1])
                problem = problem.replace(f"{got} is not one of", "expected one of").rstrip(".")
                return f"{flag}: {problem}, got {got}"
    return err.format_message().rstrip(".")


def _flush() -> None:
    """Write what is still to be said while an error of it can be told."""
    if sys.stdout is not None:
        sys.stdout.flush()


def _drop_output() -> None:
    """Python writes what is left at its end, and would tell the same error with a traceback."""
    try:
        _flush()
    except OSError:
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

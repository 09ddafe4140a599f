"""The shell of every command: one line and exit code 2 for what the user can mend, one BLAS thread."""

import sys
from collections.abc import Callable

import typer
from pydantic import ValidationError
from threadpoolctl import threadpool_limits
from typer.exceptions import TyperException

from testbench.errors import BenchError

INTERRUPTED = 130


def run(app: typer.Typer, fail: Callable[[str], object] = sys.stderr.write) -> int:
    """Run a typer app on the command line's arguments.

    Args:
        app: The command.
        fail: Where the line about an error goes.

    Returns:
        0 when it went well, 2 for input that the user can mend, 130 after Ctrl-C.
    """
    try:
        with threadpool_limits(1):  # several BLAS threads change result bits, and slow many processes down
            code = app(standalone_mode=False)
    except BenchError as err:
        fail(f"error: {err}\n")
        return 2
    except TyperException as err:
        words = err.format_message().rstrip(".")
        fail(f"error: {words}; --help lists what there is\n")
        return 2
    except ValidationError as err:
        first = err.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        fail(f"error: {place} in SI units: {first['msg']}, got {first['input']!r}\n")
        return 2
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    if code == INTERRUPTED:  # typer itself turns Ctrl-C into this code
        fail("interrupted: earlier results stand as they were\n")
    return code if isinstance(code, int) else 0

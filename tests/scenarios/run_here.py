"""A command or a scenario run in this process: starting Python and its libraries takes two seconds a time."""

import contextlib
import importlib.util
import io
import subprocess
import sys
from unittest import mock

from testbench.shell import command
from testbench.studies import run


def here(app, *args):
    """What the program would have said, and its exit code."""
    out, err = io.StringIO(), io.StringIO()
    argv = mock.patch.object(sys, "argv", ["program", *map(str, args)])
    with argv, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = command.run(app, err.write)
    return subprocess.CompletedProcess(args, code, out.getvalue(), err.getvalue())


def app_of(script):
    """The typer app of a scenario's script."""
    spec = importlib.util.spec_from_file_location(f"scenario_{script.stem}", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return run.app(module.STUDY) if hasattr(module, "STUDY") else module.app

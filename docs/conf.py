"""The documentation site: `make docs` builds it and fails on a dead link or an undocumented public name."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import testbench

HERE = Path(__file__).parent
PROGRAM = Path(sys.executable).with_name("testbench")

project = "testbench"
author = "the testbench authors"
copyright = "2026, the testbench authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.coverage", "sphinx.ext.napoleon"]
coverage_show_missing_items = True
exclude_patterns = ["_build", "README.md"]
html_theme = "furo"
html_title = "testbench"
myst_heading_anchors = 3
myst_enable_extensions = ["deflist"]
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_google_docstring = True


def write_help(_: object) -> None:
    """commands.txt: what every command says of itself."""
    shown = {**os.environ, "COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1"}

    def said(*words: str) -> str:
        done = subprocess.run(
            [PROGRAM, *words, "--help"], capture_output=True, text=True, check=True, env=shown
        )
        return f"$ testbench {' '.join(words)} --help\n{done.stdout.rstrip()}\n"

    commands = [
        "calibrate",
        "check",
        "compare",
        "compensate",
        "data check",
        "dataset build",
        "demo",
        "export",
        "identify",
        "new",
        "plan",
        "predict",
        "score",
        "simulate",
        "view",
    ]
    texts = [said(), *(said(*command.split()) for command in commands)]
    (HERE / "_build").mkdir(exist_ok=True)
    (HERE / "_build" / "commands.txt").write_text("\n".join(texts), encoding="utf-8")


def refuse_undocumented(_: object) -> None:
    """A public name without a docstring fails the build."""
    bare = [name for name in testbench.__all__ if not getattr(testbench, name).__doc__]
    if bare:
        raise RuntimeError(f"public names without a docstring: {', '.join(bare)}")


def refuse_missing(_: object, env: Any) -> None:
    """A public name that the API page lacks fails the build."""
    known = env.domains["py"].objects
    missing = [name for name in testbench.__all__ if f"testbench.{name}" not in known]
    if missing:
        raise RuntimeError(f"docs/api.md lacks {', '.join(missing)}")


def setup(app: Any) -> None:
    """Sphinx calls this first."""
    app.connect("env-check-consistency", refuse_missing)
    app.connect("builder-inited", refuse_undocumented)
    app.connect("builder-inited", write_help)

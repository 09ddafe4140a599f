"""The documentation site: `make docs` builds it and fails on a dead link or an undocumented public name."""

import atexit
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from ipykernel.kernelspec import get_kernel_dict
from jupyter_client.kernelspec import KernelSpecManager
from latex2mathml.converter import convert
from sphinx.errors import ExtensionError
from typer.testing import CliRunner

import testbench
from testbench.cli.program import program

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tools"))

from wheel import build_wheel, install_wheel  # noqa: E402

project = "testbench"
author = "the testbench authors"
copyright = "2026, the testbench authors"
extensions = ["myst_nb", "sphinx_design", "sphinx.ext.autodoc", "sphinx.ext.coverage", "sphinx.ext.napoleon"]
coverage_show_missing_items = True
exclude_patterns = ["_build", "README.md"]
html_theme = "furo"
html_title = "testbench"
# The build runs the tutorials with the installed wheel, each in an empty folder; a cell that fails ends it.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_merge_streams = True
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_default_options = {"exclude-members": "about"}  # what a repr shows
napoleon_google_docstring = True

# What the theme leaves out for screen readers and keyboards: levels, names, and focus on what scrolls.
OPENED = {
    'role="heading"><span class="caption-text"': 'role="heading" aria-level="2"><span class="caption-text"',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="All pages">',
    '<aside class="toc-drawer': '<aside aria-label="This page" class="toc-drawer',
    '<div class="highlight"><pre>': '<div class="highlight"><pre tabindex="0">',
    '<div id="search-results"></div>': '<h1>Search</h1>\n<div id="search-results"></div>',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
}


def open_to_all(app: Any, error: Exception | None) -> None:
    """Write what screen readers and keyboards need into every page."""
    if error is None and app.builder.name == "html":
        for page in Path(app.outdir).rglob("*.html"):
            text = page.read_text(encoding="utf-8")
            for old, new in OPENED.items():
                text = text.replace(old, new)
            page.write_text(text, encoding="utf-8")


def write_help(_: object) -> None:
    """Write commands.txt: the help of every command, as a terminal of 100 columns shows it."""
    shown = {"COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1"}

    def said(*words: str) -> str:
        app, asked = program(words), [*words, "--help"]
        done = CliRunner().invoke(app, asked, prog_name="testbench", env=shown, catch_exceptions=False)
        return f"$ testbench {' '.join(asked)}\n{done.stdout.rstrip()}\n"

    commands = [
        "calibrate",
        "check",
        "compare",
        "compensate",
        "data check",
        "demo",
        "export",
        "identify",
        "new",
        "plan",
        "predict",
        "simulate",
        "view",
    ]
    texts = [said(), *(said(*command.split()) for command in commands)]
    (HERE / "_build").mkdir(exist_ok=True)
    (HERE / "_build" / "commands.txt").write_text("\n".join(texts), encoding="utf-8")


def run_tutorials_by_wheel(app: Any) -> None:
    """Let tutorials use the installed wheel, not the checkout, in Python and in the shell."""
    if app.builder.name != "html" or app.config.nb_execution_mode == "off":
        return
    folder = Path(tempfile.mkdtemp(prefix="testbench-wheel-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    python = install_wheel(build_wheel(HERE.parent, folder), folder / "venv")
    kernel = folder / "kernels" / "python3"
    kernel.mkdir(parents=True)
    asked = get_kernel_dict()
    asked["argv"][0] = str(python)
    (kernel / "kernel.json").write_text(json.dumps(asked), encoding="utf-8")
    os.environ |= {"JUPYTER_PATH": str(folder), "PATH": f"{python.parent}{os.pathsep}{os.environ['PATH']}"}
    started = KernelSpecManager().get_kernel_spec("python3").argv[0]
    ask = [started, "-c", "import testbench; print(testbench.__file__)"]
    found = subprocess.run(ask, cwd=folder, capture_output=True, text=True, check=True).stdout
    if not found.startswith(str(folder / "venv")):
        raise ExtensionError(f"tutorials would run {found.strip()}, not the installed wheel")


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


def mathml(latex: str, display: str) -> str:
    """Convert LaTeX to MathML, which browsers render without a script, a font or the internet.

    Args:
        latex: The formula.
        display: "inline" or "block".

    Raises:
        ExtensionError: When it holds what latex2mathml does not know, and would print as it stands.
    """
    found = convert(latex, display=display)
    try:
        ElementTree.fromstring(found)
    except ElementTree.ParseError:
        found = "\\"
    if "\\" in found:
        raise ExtensionError(f"no MathML for {latex}")
    return found


def write_inline(writer: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    writer.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def write_equation(writer: Any, node: nodes.math_block) -> None:
    """Write an equation, its label in place of a number."""
    body = writer.body  # the theme wraps it in a box that has the anchor
    body.append('<div class="math" style="display: flex; align-items: center; padding: 0.5em 0">')
    body.append(f'<div style="flex: 1; overflow-x: auto" tabindex="0">{mathml(node.astext(), "block")}</div>')
    if node.get("label"):
        body.append(f'<span class="eqno">({node["label"]})')
        writer.add_permalink_ref(node, "Link to this equation")
        body.append("</span>")
    body.append("</div>\n")
    raise nodes.SkipNode


def cite_by_label(app: Any, doctree: nodes.document) -> None:
    """Let references to equations show their labels, not numbers."""
    for node in doctree.findall(nodes.math_block):
        if node.get("label"):
            app.env.domaindata["math"]["objects"][node["label"]] = (app.env.docname, node["label"])


def setup(app: Any) -> None:
    """Sphinx calls this first."""
    app.add_html_math_renderer("mathml", (write_inline, None), (write_equation, None))
    app.connect("doctree-read", cite_by_label)
    app.connect("env-check-consistency", refuse_missing)
    app.connect("builder-inited", refuse_undocumented)
    app.connect("builder-inited", write_help)
    app.connect("builder-inited", run_tutorials_by_wheel)
    app.connect("build-finished", open_to_all)

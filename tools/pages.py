"""The pages of docs/studies from full runs, and the numbers of README.md and docs: none is typed.

python tools/pages.py --runs runs/full
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from blocks import fill

from testbench.errors import BenchError
from testbench.shell import command

ROOT = Path(__file__).resolve().parents[1]
PAGES, README = ROOT / "docs" / "studies", ROOT / "README.md"
STUDIES = (
    "gravity_calibration", "single_link", "six_dof_arm", "solver_comparison", "loaded_stiffness",
    "identifiability", "noise_sensitivity", "model_error", "pose_selection", "which_model",
    "regimes", "real_ur10", "absolute_calibration", "compensation",
)  # fmt: skip
DEMO = re.compile(r"(<!-- demo -->\n).*?(<!-- end -->)", re.DOTALL)

app = typer.Typer(add_completion=False)


@app.command()
def main(
    runs: Annotated[Path, typer.Option(help="Folder with one folder a study.")] = ROOT / "runs" / "full",
    bench: Annotated[Path, typer.Option(help="What `make bench` wrote.")] = ROOT / "runs/bench/bench.json",
    demo: Annotated[bool, typer.Option(help="Run the demo and write its table into README.md.")] = True,
) -> None:
    """Write every page whose run is there."""
    found = [name for name in STUDIES if (runs / name / "report.md").is_file()]
    if not found:
        raise BenchError(f"no run of a study in {runs}")
    for name in found:
        page(name, runs / name)
        print(PAGES / f"{name}.md")
    for own in (README, *sorted(PAGES.parent.glob("*.md"))):
        if fill(own, runs, bench):
            print(own)
    if demo:
        text = README.read_text(encoding="utf-8")
        README.write_text(DEMO.sub(rf"\g<1>{shown()}\g<2>", text), encoding="utf-8")


def page(name: str, run: Path) -> None:
    """A study's page: how to run it, its figure, its report.md."""
    _, _, rest = (run / "report.md").read_text(encoding="utf-8").partition("\n")
    pictures = [run / f"{name}.png", run / "models.png", run / "curves.png"]
    shutil.copyfile(next(png for png in pictures if png.is_file()), PAGES / f"{name}.png")
    asked = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    flags = f"--seed {asked['seed']} --seeds {asked['seeds']}"
    if "campaigns" in asked["scenario"]:
        flags += f" --campaigns {asked['scenario']['campaigns']}"
    parts = [
        f"# {name.replace('_', ' ').capitalize()}",
        f"    python scenarios/{name}.py {flags} --out runs/{name}",
        f"![{name}]({name}.png)",
        re.sub(r"!\[[^]]*\]\([^)]*\)\n", "", rest).strip(),
    ]
    (PAGES / f"{name}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def shown() -> str:
    """What the demo prints, up to its words."""
    with tempfile.TemporaryDirectory() as out:
        script = [sys.executable, ROOT / "scenarios" / "gravity_calibration.py"]
        flags = ["--seed", "1", "--true-arm", "cast", "--out", out]
        done = subprocess.run([*script, *flags], capture_output=True, text=True, check=True)
    lines = done.stdout.partition("\n •")[0].strip("\n").split("\n")
    return "\n".join(f"    {line}".rstrip() for line in lines) + "\n\n"


if __name__ == "__main__":
    sys.exit(command.run(app))

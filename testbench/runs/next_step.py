"""Next steps after a run: the last lines that a command prints."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import JsonValue

from testbench.errors import printable, shell_word
from testbench.runs.manifest import read_manifest
from testbench.runs.session import SESSION

MISSING = {
    "check": "numbers confirmed in elastic.toml, a table of task poses",
    "plan": "readings of all poses of plan.csv, {readings}",
    "data check": "a map file, if a column was misunderstood",
    "identify": "a table of poses, or a program",
    "calibrate": "a new series of readings, to score the model",
    "predict": "a program as a table",
}
"""What only the user can give, by command."""

COMMANDS = {
    "check": ["plan {arm} --task TASKS.csv --poses 12 --load KG --out {beside}plan"],
    "plan": [
        "simulate {arm} {run}/plan.csv{flags} --out rehearsal.csv",
        "data check {arm} MEASURED.csv --out {beside}data",
        "identify {arm} MEASURED.csv{fit} --out {beside}model",
    ],
    "plan absolute": [
        "simulate {arm} {run}/plan.csv{flags} --out rehearsal.csv",
        "calibrate {arm} {given}MEASURED.csv --out {beside}model",
    ],
    "data check": ["identify {arm} {data}{flags} --out {beside}model"],
    "identify": ["predict {run} POSES.csv", "compensate {run} PROGRAM.csv --out CORRECTED.csv"],
    "calibrate": [
        "calibrate {run} READINGS.csv --score --frame-poses 50",
        "compensate {run} PROGRAM.csv --out CORRECTED.csv",
    ],
    "predict": ["compensate {model} PROGRAM.csv --out CORRECTED.csv"],
    "study": ["compare {run} OTHER_RUN", "new MY_ARM --from ROBOT.urdf"],
}
"""The commands that follow, by command."""
LEFT_OUT = {
    "arm": " {arm}",
    "load": " --load KG",
}  #: Their words that a project file makes needless, by its keys.


def next_lines(run: Path, given: Sequence[Path] = (), **known: str | Path) -> list[str]:
    """Say what is missing after a run, and the next command, filled in as far as the run tells.

    Args:
        run: Its folder.
        given: Readings that a plan was made beside; else their names that the run has.
        known: `arm`, `model` or `data` as the user named it; else the name that the run has, found here or
            beside the run.

    Returns:
        Lines; none of a folder that is not that of a finished run.
    """
    about = read_manifest(run)
    name = about.command.removeprefix("testbench ")
    asked = about.scenario if isinstance(about.scenario, dict) else {}
    absolute = bool(asked.get("absolute"))
    named = printable(next(iter(about.models), "ARM"))
    data, names = asked.get("data"), asked.get("given")
    if not given and isinstance(names, list):
        given = [_placed(run, str(name)) for name in names]
    fields = {
        "run": shell_word(run),
        "beside": "" if run.parent == Path() else f"{shell_word(run.parent)}/",
        "readings": "in the tracker's frame" if absolute else "without and with the load",
        "flags": _rehearsal(asked) if absolute else printable(str(asked.get("flags", ""))) + _gauges(asked),
        "fit": _fit(asked),
        "given": "".join(f"{shell_word(path)} " for path in given),
        "arm": named,
        "model": shell_word(_placed(run, next(iter(about.models), "MODEL"))),
        "data": shell_word(_placed(run, data)) if isinstance(data, str) else "MEASURED.csv",
    } | {key: shell_word(Path(value)) for key, value in known.items()}
    key = "plan absolute" if name == "plan" and absolute else name
    texts = list(COMMANDS.get(key, COMMANDS["study"] if name.startswith("scenarios/") else ()))
    for key, words in LEFT_OUT.items():
        texts = [text.replace(words, "") for text in texts] if key in SESSION.get().known else texts
    mapped = "--map" in fields["flags"] or "map" in SESSION.get().taken
    lines = [f"{'needed':<11}{MISSING[name]}"] if name in MISSING and not mapped else []
    lines += [f"{'' if k else 'next':<11}testbench {text}" for k, text in enumerate(texts)]
    return [line.format_map(fields) for line in lines]


def _placed(run: Path, name: str) -> Path:
    """What a run has by its name alone: as it is here, else beside the run if it is there."""
    beside = run.parent / name
    return beside if os.path.lexists(beside) and not os.path.lexists(name) else Path(name)


def _rehearsal(asked: Mapping[str, JsonValue]) -> str:
    """Flags of `simulate` that rehearse a plan of absolute readings."""
    flags = " --absolute"
    for key, flag in (("gear_urad", "--gear-urad"), ("geometry_mm", "--geometry-mm")):
        value = asked.get(key)
        flags += f" {flag} {value:g}" if isinstance(value, float) else ""
    loads = asked.get("loads_kg")
    masses = [kg for kg in loads if isinstance(kg, float)] if isinstance(loads, list) else []
    flags += " --orientations" if asked.get("orientations") else ""
    return flags + (f" --loads {','.join(f'{kg:g}' for kg in masses)}" if len(masses) > 1 else "")


def _gauges(asked: Mapping[str, JsonValue]) -> str:
    """Flag of `simulate` that reads the gauges of a plan."""
    return " --instrument planned" if asked.get("gauges") else ""


def _fit(asked: Mapping[str, JsonValue]) -> str:
    """Flags of `identify` that fit the model that a plan was made for."""
    model = asked.get("model")
    named = f" --model {printable(model)}" if isinstance(model, str) else ""
    return named + (" --no-prior" if asked.get("uncertainty_percent") is None else "")

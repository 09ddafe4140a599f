"""testbench.toml of the current folder: values of flags that are about a cell and its files.

One place gives them to every command: a key is the name of a command's parameter, as `ALIASES` says where the
two differ. Flags count more, then what it says of a file, then what it says of all.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import typer
from pydantic import AfterValidator, BeforeValidator, Field, ValidationError
from pydantic_core import PydanticCustomError
from typer.core import TyperCommand

from testbench import files
from testbench.arm.catalogue import find_arm
from testbench.arm.document import Strict, parse_toml
from testbench.arm.lines import toml_place
from testbench.errors import BenchError, InputError, read_text, sheet_of
from testbench.output.session import NONE, Session

NAME = Path("testbench.toml")
MAX_BYTES = 50_000
READ = ("dataset", "readings")  #: Parameters that are files of readings.
FILES = (*READ, "program", "poses", "task")  #: Parameters whose files may have values of their own.
ARM = "testbench.arm"  #: Where a context keeps the arm that was taken from the file.
ALIASES = {"map": "mapping", "targets": "new_target"}  #: Parameters by their keys where these differ.


def _mass(value: object) -> float:
    """A mass [kg] as flags have it: 240 or "530lb"."""
    from testbench.campaign.plan_input import read_mass  # here: few commands read masses

    try:
        return read_mass(str(value))
    except BenchError as err:
        raise PydanticCustomError("mass", "{problem}", {"problem": str(err)}) from err


def _several(value: object) -> list[object]:
    return list(value) if isinstance(value, (list, tuple)) else [value]


def _commas(value: list[float]) -> str:
    return ",".join(f"{x:g}" for x in value)


Text = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^-]")]
Number = Annotated[float, Field(ge=-1000, le=1000)]
Place = Annotated[list[Number], Field(min_length=3, max_length=3), AfterValidator(_commas)]
Box = Annotated[list[Number], Field(min_length=6, max_length=6), AfterValidator(_commas)]
Mass = Annotated[float, BeforeValidator(_mass)]
Sigma = Annotated[float, Field(ge=0.001, le=10_000)]


class OwnFile(Strict):
    """What holds for one file alone."""

    map: Text | None = Field(None, description="its names of our quantities")
    load: Mass | None = Field(None, description="hangs in its loaded rows, where it gives no mass")
    payload: Mass | None = Field(None, description="that a program carries, where it gives none")
    sigma_um: Sigma | None = None
    frame: Text | None = None


class Project(Strict):
    """What holds for a cell; `testbench init` writes the descriptions."""

    arm: Text | None = Field(None, description="folder of the arm, or one of ours", examples=["my_arm"])
    urdf: Text | None = Field(None, description="the robot's own, for export", examples=["robot.urdf"])
    map: Text | None = Field(
        None, description="how readings name our quantities; see testbench data map", examples=["map.toml"]
    )
    sigma_um: Sigma | None = Field(None, description="noise of a reading along an axis", examples=[50])
    frame: Text | None = Field(
        None,
        description="of readings: auto, base, tracker, or a TOML file with the base's",
        examples=["auto"],
    )
    targets: list[Text] = Field([], description="that the arm's folder lacks", examples=[["P9"]])
    load: Annotated[list[Mass], BeforeValidator(_several)] = Field(
        [], description="to hang when measuring, kg or with a unit; several for a choice", examples=[240]
    )
    payload: Mass | None = Field(
        None, description="that programs carry, where they give none", examples=["120kg"]
    )
    tracker: Place | None = Field(None, description="where it stands, m, for plans", examples=[[4, -2, 1.5]])
    acceptance_deg: Annotated[float, Field(ge=0.1, le=90)] | None = Field(
        None, description="half angle of fixed targets", examples=[30]
    )
    floor_z: Number | None = Field(None, description="height of a floor, m", examples=[0])
    box: Box | None = Field(
        None, description="corners of the work area, m", examples=[[1, -1, 0.2, 2.5, 1, 2]]
    )
    sling_m: Annotated[float, Field(ge=0, le=100)] | None = Field(
        None, description="from the load point to the weight", examples=[0.5]
    )
    tool_point: Place | None = Field(
        None, description="of programs, in the tool's frame, m", examples=[[0, 0, 0.1]]
    )
    spindle: Literal["x", "-x", "y", "-y", "z", "-z"] | None = Field(
        None, description="where it points in the tool's frame", examples=["z"]
    )
    files: dict[Text, OwnFile] = Field({}, max_length=200)


def read_project(path: Path = NAME) -> Project | None:
    """What the project file says; None where there is none.

    Raises:
        InputError: Names the key and what was expected.
    """
    return parse_project(path, read_text(path, MAX_BYTES)) if path.is_file() else None


def parse_project(path: Path, text: str) -> Project:
    """The same of the text of a file."""
    try:
        found = Project.model_validate(parse_toml(path, text))
    except ValidationError as err:
        first = err.errors(include_url=False, include_context=False)[0]
        place = toml_place(path, first["loc"])
        if first["type"] == "extra_forbidden":
            keys = (Project if len(first["loc"]) == 1 else OwnFile).model_fields
            raise InputError(path, place, f"unknown key; keys are {', '.join(keys)}") from err
        raise InputError(path, place, f"{first['msg']}, got {str(first['input'])[:80]!r}") from err
    _check_files(path, found)
    return found


def _check_files(path: Path, found: Project) -> None:
    """Refuse names of files that are not there: a slip would leave their values out."""
    if found.arm is not None:
        try:
            find_arm(found.arm)
        except BenchError as err:
            raise InputError(path, toml_place(path, ["arm"]), str(err)) from err
    named: list[tuple[tuple[str, ...], str | None]] = [(("map",), found.map)]
    for file, own in found.files.items():
        named += [(("files", file), file), (("files", file, "map"), own.map)]
    for keys, name in named:
        if name is not None and not sheet_of(Path(name))[0].is_file():
            raise InputError(path, toml_place(path, keys), f"expected a file, there is no {name}")


class ProjectCommand(TyperCommand):
    """A command whose parameters take what the project file says where the command line does not."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Parse the command line, with the project's values below it."""
        if not ctx.resilient_parsing and not {*args} & {*ctx.help_option_names}:
            found = read_project()
            if found is not None:
                args = self._with_arm(ctx, args, found.arm)
                ctx.obj, ctx.default_map = found, self._defaults(found)
        return super().parse_args(ctx, args)

    def _with_arm(self, ctx: typer.Context, args: list[str], arm: str | None) -> list[str]:
        """The words behind the project's arm, unless the first of them is an arm."""
        wanted = [p for p in self.params if p.param_type_name == "argument"]
        if arm is None or not wanted or wanted[0].name != "arm":
            return args
        parsed = self.make_parser(ctx).parse_args(list(args))[0]
        given = [parsed.get(str(own.name)) for own in wanted]
        words = [word for own in given for word in _several(own) if isinstance(word, str)]
        few = len(words) < sum(own.required for own in wanted)
        if not words or sheet_of(Path(words[0]))[0].is_file() or (few and not _is_arm(words[0])):
            ctx.meta[ARM] = arm
            return [arm, *args]
        return args

    def _defaults(self, found: Project) -> dict[str, object]:
        """Values of parameters, as words of a command line."""
        own = {str(p.name): p for p in self.params if p.param_type_name == "option"}
        reads, values = {p.name for p in self.params} & {*READ}, dict[str, object]()
        for key in Project.model_fields.keys() - {"files"}:
            name, words = _param(key), list(map(str, _several(getattr(found, key))))
            if name not in own or words in ([], ["None"]) or (key == "map" and not reads):
                continue
            if key == "load" and "readings" in reads:
                continue  # without a mass their rows may be of the arm's own weight alone
            if getattr(own[name], "multiple", False):
                values[name] = words
            elif len(words) == 1:  # of several loads the file says which
                [values[name]] = words
        return values


def merged(ctx: typer.Context, values: Mapping[str, object]) -> tuple[dict[str, object], Session]:
    """Parameters with what the project file says of single files, and what there is to say of it.

    A command of several files gets lists of such values, one for each file.
    """
    found, values = ctx.obj, dict(values)
    if not isinstance(found, Project):
        return values, NONE
    source = {name: str(getattr(ctx.get_parameter_source(name), "name", "")) for name in values}
    taken = {
        key: getattr(found, key) for key in Project.model_fields if source.get(_param(key)) == "DEFAULT_MAP"
    }
    taken |= {"arm": found.arm} if ARM in ctx.meta else {}
    for name in values.keys() & {*FILES} if found.files else ():
        tables = [(path, _own(found, path)) for path in _several(values[name]) if isinstance(path, Path)]
        for key in OwnFile.model_fields:
            said = [getattr(table, key, None) for _, table in tables]
            param, several = _param(key), isinstance(values[name], list)
            if not any(said) or source.get(param, "COMMANDLINE") == "COMMANDLINE":
                continue
            if several:
                [rest] = _several(values[param] or None)
                values[param] = [rest if own is None else _typed(key, own) for own in said]
            elif not isinstance(values[param], list):
                values[param] = _typed(key, said[0])
            taken[key] = {
                path.name: own for (path, _), own in zip(tables, said, strict=True) if own is not None
            }
    known = frozenset(key for key in Project.model_fields if getattr(found, key))
    return values, Session({"file": str(NAME), "sha256": files.digest(NAME), "taken": taken}, known)


def _own(found: Project, path: Path) -> OwnFile | None:
    """What the project file says of a file, however it is named."""
    return next((own for name, own in found.files.items() if Path(name).resolve() == path.resolve()), None)


def _typed(key: str, value: object) -> object:
    return Path(str(value)) if key == "map" else value


def _param(key: str) -> str:
    return ALIASES.get(key, key)


def _is_arm(word: str) -> bool:
    try:
        find_arm(word)
    except BenchError:
        return False
    return True

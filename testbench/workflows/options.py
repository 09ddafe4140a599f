"""Flags as a dataclass: each field is a flag, so that a command takes one settings object.

testbench.toml of the current folder may hold values of flags that are about a cell and its files: one place
gives them to every command. A key is the name of a command's parameter, as `ALIASES` says where the two
differ. Flags count most, then what the file says of one file, then what it says of all.
"""

import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_type_hints

import typer
from pydantic import AfterValidator, BeforeValidator, Field, ValidationError
from pydantic_core import PydanticCustomError
from typer.core import TyperCommand

from testbench.arm.document import (
    StrictModel,
    first_invalid_value,
    is_decimal,
    parse_toml,
    text_matching,
    toml_place,
)
from testbench.arm.elastic import PAYLOAD_RANGE
from testbench.arm.folder import Arm, find_arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import BenchError, InputError, read_text, sheet_of
from testbench.errors import of_flag as of_flag
from testbench.files.names import UNITS, find_unit
from testbench.runs import manifest as files
from testbench.runs.follow import followed
from testbench.runs.interrupt import EMPTY_SESSION, Session

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from _typeshed import DataclassInstance

# --- Masses that hang from an arm ---------------------------------------------------------------------------

OVERLOAD = 1.5  #: Share of the stated payload beyond which a hung mass is doubted.
MASSES = tuple(unit.name for unit in UNITS if unit.si in ("kg", "N"))
QUANTITY = re.compile(r"\s*([-+.\d]+(?:[eE][-+]?\d+)?)\s*([^\d\s].*)?")


def read_mass(text: str) -> float:
    """Read a hung mass: 240, 240kg, 530 lb; or its weight, 2354 N [kg]; BenchError if wrong."""
    parts = QUANTITY.fullmatch(text)
    unit = find_unit(parts[2] or "kg") if parts is not None else None
    if parts is None or not is_decimal(parts[1]) or unit is None or unit.name not in MASSES:
        raise BenchError(f"expected a mass such as 240, 240kg or 530lb; units are {', '.join(MASSES)}")
    found = float(parts[1]) * unit.scale / (GRAVITY if unit.si == "N" else 1.0)
    low, high = PAYLOAD_RANGE
    if not low <= found <= high:
        raise BenchError(f"expected {low:g} to {high:g} kg")
    return found


def read_masses(text: str) -> list[float]:
    """Read masses, MASS,MASS ... [kg]; BenchError for anything but different ones that can hang."""
    try:
        masses = [read_mass(part) for part in text.split(",")]
    except BenchError as err:
        raise BenchError(f"--loads: {err}, got {text[:80]!r}") from err
    if len(set(masses)) < len(masses):
        raise BenchError(f"--loads: expected different masses, got {text[:80]!r}")
    return masses


def payload_of(arm: Arm, asked: float | None, flag: str) -> float:
    """Return the mass that a flag asks for, else the payload that the arm states, else BenchError.

    Args:
        arm: Description of the arm.
        asked: Mass of the flag [kg]; None if not given.
        flag: Name of the flag.

    Returns:
        Mass [kg].
    """
    if asked is not None:
        return asked
    if arm.payload is None:
        raise BenchError(f"{flag}: expected a mass [kg], as {arm.name} states no payload in elastic.toml")
    return arm.payload


def overload_warnings(arm: Arm, masses: Iterable[float], pulls: Iterable[Sequence[float]] = ()) -> list[str]:
    """Warn of masses or pulls far beyond the payload that the arm states.

    Args:
        arm: Description of the arm.
        masses: Masses [kg].
        pulls: Forces, (3,) each [N].

    Returns:
        Sentences.
    """
    most = OVERLOAD * (math.inf if arm.payload is None else arm.payload)
    mass, force = max(masses), max((math.hypot(*pull) for pull in pulls), default=0.0)
    stated = f"an arm that states a payload of {arm.payload or 0:g} kg"
    found = [f"{mass:.4g} kg hang from {stated}"] * (mass > most)
    return found + [f"{force:.4g} N pull at {stated}"] * (force > GRAVITY * most)


# --- Flags as a dataclass: each field is a flag, so that a command takes one settings object ----------------

NAME = Path("testbench.toml")
TEMPLATE = Path(__file__).with_name("project.toml")  #: All keys, as comments.
MAX_BYTES = 50_000
READ = {"dataset", "readings"}  #: Parameters that are files of readings.
FILES = (*READ, "program", "poses", "task")  #: Parameters whose files may have values of their own.
ARM = "testbench.arm"  #: Where a context keeps the arm that was taken from the file.
NEEDLESS = {"urdf": "into"}  #: Parameters that another flag makes needless, and that flag.
ALIASES = {"map": "mapping", "targets": "new_target"}  #: Parameters by their keys where these differ.


def _check_mass(value: object) -> object:
    """A mass as flags have it: 240 or "530lb"."""
    try:
        read_mass(str(value))
    except BenchError as err:
        raise PydanticCustomError("mass", "{problem}", {"problem": str(err)}) from err
    return str(value)


def _several(value: object) -> list[object]:
    return list(value) if isinstance(value, (list, tuple)) else [value]


def _check_arm(name: str) -> str:
    if not _is_arm(name):
        raise PydanticCustomError("arm", "expected the folder of an arm, or the name of one of ours")
    return name


def _exists(name: str) -> str:
    if not sheet_of(Path(name))[0].is_file():
        raise PydanticCustomError("file", "expected a file that exists")
    return name


Text = Annotated[
    str, Field(min_length=1, max_length=200), text_matching("[^-].*", "a text that does not begin with -")
]
File = Annotated[Text, AfterValidator(_exists)]
Mass = Annotated[str, BeforeValidator(_check_mass)]
Place = Annotated[
    str,
    text_matching(
        r"[-+.\de]+(,[-+.\de]+){2}", "a text of three numbers with commas between, such as 2.5,0,1"
    ),
]
Box = Annotated[str, text_matching(r"[-+.\de]+(,[-+.\de]+){5}", "a text of six numbers with commas between")]


class FileSettings(StrictModel):
    """Hold what holds for one file alone."""

    map: File | None = None
    load: Mass | None = None
    payload: Mass | None = None
    frame: Text | None = None


class Project(StrictModel):
    """Hold what holds for a cell; the template says what each is."""

    arm: Annotated[Text, AfterValidator(_check_arm)] | None = None
    urdf: Text | None = None
    map: File | None = None
    sigma_um: Annotated[float, Field(ge=0.001, le=10_000)] | None = None
    frame: Text | None = None
    targets: tuple[Text, ...] = Field((), strict=False)
    load: Annotated[tuple[Mass, ...], BeforeValidator(_several)] = Field((), strict=False)
    payload: Mass | None = None
    tracker: Place | None = None
    acceptance_deg: Annotated[float, Field(ge=0.1, le=90)] | None = None
    box: Box | None = None
    floor_z: Annotated[float, Field(ge=-1000, le=1000)] | None = None
    sling_m: Annotated[float, Field(ge=0, le=100)] | None = None
    tool_point: Place | None = None
    spindle: Literal["x", "-x", "y", "-y", "z", "-z"] | None = None
    files: dict[File, FileSettings] = Field({}, max_length=200)


def read_project() -> Project | None:
    """Read the project file; None where there is none.

    Raises:
        InputError: Names the key and what was expected.
    """
    if not NAME.is_file():
        return None
    try:
        return Project.model_validate(parse_toml(NAME, read_text(NAME, MAX_BYTES)))
    except ValidationError as err:
        keys, kind, problem = first_invalid_value(err)
        if kind == "extra_forbidden":
            known = (Project if len(keys) == 1 else FileSettings).model_fields
            problem = f"unknown key; keys are {', '.join(known)}"
        raise InputError(NAME, toml_place(NAME, keys), problem) from err


class ProjectCommand(TyperCommand):
    """Take parameters from the project file where the command line does not give them."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Parse the command line, with the project's values below it.

        Args:
            ctx: Context of the command.
            args: Words of the command line.

        Returns:
            Words that are left.
        """
        if not ctx.resilient_parsing and not {*args} & {*ctx.help_option_names}:
            project = read_project()
            if project is not None:
                args = self._with_arm(ctx, args, project.arm)
                ctx.obj, ctx.default_map = project, self._defaults(project)
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

    def _defaults(self, project: Project) -> dict[str, object]:
        """Values of parameters, as words of a command line."""
        own = {str(p.name): p for p in self.params if p.param_type_name == "option"}
        reads, values = {p.name for p in self.params} & READ, dict[str, object]()
        skipped = {"files", *([] if reads else ["map"])}
        if "readings" in reads:
            skipped.add("load")  # rows without a mass may be of the arm's own weight alone
        for key in Project.model_fields.keys() - skipped:
            name = ALIASES.get(key, key)
            words = [str(word) for word in _several(getattr(project, key)) if word is not None]
            if name in own and words and getattr(own[name], "multiple", False):
                values[name] = words
            elif name in own and len(words) == 1:  # of several loads the file says which
                [values[name]] = words
        return values


def _is_arm(word: str) -> bool:
    try:
        find_arm(word)
    except BenchError:
        return False
    return True


def merged(ctx: typer.Context, values: Mapping[str, object]) -> tuple[dict[str, object], Session]:
    """Merge parameters with what the project file says of single files.

    A command of several files gets lists of such values, one for each file.

    Args:
        ctx: Context of the command.
        values: Parameters by name.

    Returns:
        The parameters, and the session.
    """
    found, values = ctx.obj, dict(values)
    if not isinstance(found, Project):
        return values, EMPTY_SESSION
    source = {name: getattr(ctx.get_parameter_source(name), "name", "") for name in values}
    for name, other in NEEDLESS.items():
        if source.get(name) == "DEFAULT_MAP" and values.get(other) is not None:
            values[name], source[name] = None, "DEFAULT"
    names = {key: ALIASES.get(key, key) for key in Project.model_fields}
    taken = {key: getattr(found, key) for key, name in names.items() if source.get(name) == "DEFAULT_MAP"}
    taken |= {"arm": found.arm} if ARM in ctx.meta else {}
    for name in values.keys() & {*FILES} if found.files else ():
        several, paths = isinstance(values[name], list), [Path(str(path)) for path in _several(values[name])]
        for key in FileSettings.model_fields:
            said = [getattr(_own(found, path), key, None) for path in paths]
            if not any(said) or source.get(names[key], "COMMANDLINE") == "COMMANDLINE":
                continue
            typed = {"map": Path, "frame": str}.get(key, read_mass)
            [rest] = _several(values[names[key]] or None) if several else [None]
            each = [rest if text is None else typed(text) for text in said]
            values[names[key]] = each if several else each[0]
            taken[key] = {path.name: text for path, text in zip(paths, said, strict=True) if text is not None}
    known = frozenset(key for key in names if getattr(found, key))
    return values, Session({"file": str(NAME), "sha256": files.digest(NAME), "taken": taken}, known)


def _own(project: Project, path: Path) -> FileSettings | None:
    """What the project file says of a file, however it is named."""
    return next(
        (settings for name, settings in project.files.items() if Path(name).resolve() == path.resolve()), None
    )


Force = Annotated[bool, typer.Option("--force", help="Replace what another command wrote.")]
Recording = Annotated[bool, typer.Option("--recording", help="Write recording.rrd for the Rerun viewer too.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print errors only.")]
QUIET = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet)
Print = Annotated[
    bool, typer.Option("--print", help="Write figures as SVG too: 183 and 89 mm, light and dark.")
]
PRINT = inspect.Parameter("print", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Print)
CONTEXT = inspect.Parameter("ctx", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)


def takes(*kinds: type, draws: bool = False) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a typer command of a function of dataclasses: their fields are its flags.

    A field is `Annotated[type, typer.Option(help=...)]` or typer.Argument; its default is the flag's.

    Args:
        kinds: The dataclasses, with fields of different names.
        draws: Whether it leaves figures, which `--print` writes as SVG too.

    Returns:
        A decorator.
    """

    def wrap(body: Callable[..., None]) -> Callable[..., None]:
        def command(ctx: typer.Context, **values: object) -> None:
            values, own = merged(ctx, values)
            _check_finite(values)
            own = own._replace(prints=bool(values.pop("print", False)))
            with followed(own, quiet=bool(values.pop("quiet"))):
                body(*(k(**{f.name: values[f.name] for f in fields(k)}) for k in kinds))

        parameters = [parameter for k in kinds for parameter in _parameters(k)]
        parameters += [*[PRINT] * draws, CONTEXT, QUIET]
        parameters.sort(key=lambda p: p.default is not inspect.Parameter.empty)
        command.__name__, command.__doc__ = body.__name__, body.__doc__
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {p.name: p.annotation for p in parameters}
        return command

    return wrap


def _check_finite(values: Mapping[str, object]) -> None:
    """Refuse flags that are no number: they pass any range."""
    for name, value in values.items():
        for number in value if isinstance(value, list) else [value]:
            if isinstance(number, float) and not math.isfinite(number):
                raise BenchError(f"--{name.replace('_', '-')}: expected a finite number, got {number}")


def _parameters(kind: type) -> list[inspect.Parameter]:
    hints = get_type_hints(kind, include_extras=True)
    found = []
    for own in fields(kind):
        default = own.default if own.default_factory is MISSING else own.default_factory()
        empty = inspect.Parameter.empty if default is MISSING else default
        found.append(
            inspect.Parameter(
                own.name, inspect.Parameter.KEYWORD_ONLY, default=empty, annotation=hints[own.name]
            )
        )
    return found


@dataclass(frozen=True)
class Common:
    """Hold the flags of every study."""

    seed: Annotated[int, typer.Option(min=0, max=2**62, metavar="N", help="Seed of all random numbers.")] = 1
    seeds: Annotated[
        int | None,
        typer.Option(min=1, max=1_000_000, metavar="N", help="Number of trials, each with a seed."),
    ] = None
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the results.")] = None
    force: Force = False
    quick: Annotated[bool, typer.Option("--quick", help="Run few and small trials.")] = False
    workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes (default: one per core).")
    ] = None
    cluster: Annotated[
        str | None,
        typer.Option(metavar="tls://HOST:PORT", help="Dask scheduler that runs the trials."),
    ] = None
    insecure: Annotated[bool, typer.Option("--insecure", help="Allow tcp:// to another machine.")] = False
    resume: Annotated[bool, typer.Option("--resume", help="Continue a stopped run.")] = False


def plain(*asked: object, read: str, without: Sequence[str] = ()) -> dict[str, object]:
    """Collect flags as plain data but for results and their places; of files their names and digests.

    Args:
        read: Field that is a file or several, beside `mapping`.
        without: Other fields that are left out.
        asked: The flags, dataclasses.

    Returns:
        The flags by name.
    """
    left = {"out", "report", "force", "recording", *without}
    flags = {name: value for own in asked for name, value in vars(own).items() if name not in left}
    for name in (read, "mapping"):
        given = flags[name] if isinstance(flags[name], list) else [flags[name]]
        flags[name] = {path.name: files.digest(path) for path in filter(None, given)} or None
    return flags


def absolute_alone(flags: "DataclassInstance") -> None:
    """Refuse flags of absolute readings that are not the defaults where `absolute` is not asked for.

    Raises:
        BenchError: Names the first one.
    """
    if not getattr(flags, "absolute", True):
        refuse_flags(flags, [own.name for own in fields(flags)], "is only for --absolute")


def refuse_flags(flags: "DataclassInstance", names: Sequence[str], why: str) -> None:
    """Refuse flags that are not the defaults.

    Args:
        flags: All flags of a command.
        names: Names of the fields that must not be given.
        why: What the message says behind the flag.

    Raises:
        BenchError: Names the first one.
    """
    for own in fields(flags):
        if own.name in names and getattr(flags, own.name) != own.default:
            raise BenchError(f"--{own.name.replace('_', '-')} {why}")


def mass(text: str) -> float:
    """Read a hung mass, or its weight [kg]; BadParameter for anything else."""
    try:
        return read_mass(text)
    except BenchError as err:
        raise typer.BadParameter(str(err)) from err


def mass_or_none(text: str) -> float:
    """Read a hung mass [kg]; 0 where nothing hangs."""
    return 0.0 if is_decimal(text) and float(text) == 0 else mass(text)


ArmName = Annotated[str, typer.Argument(help="Folder of an arm, or name of a built-in one.")]
MapFile = Annotated[Path | None, typer.Option("--map", metavar="TOML", help="Map of the table's columns.")]
SigmaUm = Annotated[
    float | None,
    typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise per axis, if the file has none."),
]
Load = Annotated[
    float | None,
    typer.Option(
        parser=mass,
        metavar="MASS",
        help="Payload if the file has none: 240 or 530lb.",
    ),
]
Payload = Annotated[
    float | None,
    typer.Option(
        "--load",
        parser=mass_or_none,
        metavar="MASS",
        help="Hung mass if the file has no load (default: rated).",
    ),
]
RunFolder = Annotated[Path, typer.Argument(help="Folder of a run, or one recording.")]
ArmCheck = Annotated[str | None, typer.Option(metavar="ARM", help="Stop if the model is of another arm.")]
ShownFolder = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder for picture, recording and page.")
]
Orientations = Annotated[
    bool, typer.Option("--orientations", help="Read one target's position and orientation.")
]

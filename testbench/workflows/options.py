"""Flags as a dataclass: each field is a flag, so that a command takes one settings object."""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Annotated, TypeVar, get_type_hints

import typer

from testbench.errors import BenchError
from testbench.errors import of_flag as of_flag
from testbench.runs.follow import followed
from testbench.workflows.project import merged

D = TypeVar("D")
Force = Annotated[bool, typer.Option("--force", help="Replace what another command wrote.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print errors only.")]
QUIET = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet)
Print = Annotated[bool, typer.Option("--print", help="Write figures as SVG too, light and dark.")]
PRINT = inspect.Parameter("print", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Print)
CONTEXT = inspect.Parameter("ctx", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)


def takes(
    kind: type[D], *more: type, draws: bool = False
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a typer command of a function of dataclasses: their fields are its flags.

    A field is `Annotated[type, typer.Option(help=...)]` or typer.Argument; its default is the flag's.

    Args:
        kind: The first dataclass.
        more: Others, with fields of other names.
        draws: Whether it leaves figures, which `--print` writes as SVG too.

    Returns:
        A decorator.
    """
    kinds = (kind, *more)

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

"""The order m of the vector space, Eq. (20): what each one reaches, and which to take."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from testbench.studies.single_link.judge import Prediction, eigenvalues
from testbench.studies.single_link.trial import GCO, LinkRow
from testbench.trials.spread import Number, ends, grouped, merge, middle

AT_OPTIMUM = 1e-6
"""Share of F_M by which a local solve may exceed the certified optimum and still have reached it."""


@dataclass(frozen=True)
class Order:
    """An order over some draws."""

    m: int  #: Vectors, and so the highest rank of C.
    name: str  #: Of the model.
    f_m: Number  #: The best of some local solves.
    excess_percent: Number  #: Of F_M over the certified optimum.
    f_m_over_optimum: Number  #: The same over the certified optimum of the same data.
    reaches_optimum: float  #: Share of the draws in which the two are the same.
    rank_of_C: Mapping[str, int]  #: Draws by the number of eigenvalues beyond rounding.
    conservative: float  #: Share of the draws.
    eigenvalues: list[Number]  #: Of C, ascending, each over the draws [m/N, rad/(N m)].
    prediction: Prediction  #: Errors of deflections.


LEAST = 1e-8  #: Excess of F_M below is rounding of two solvers [1].


def orders(draws: Sequence[Sequence[LinkRow]]) -> list[Order]:
    """Every order over the draws in which it was tried."""
    optimum = {id(row): _optimum(rows) for rows in draws for row in rows}
    by_m = grouped([row for rows in draws for row in rows if row.m is not None], lambda row: row.m or 0)
    return [_order(m, rows, [optimum[id(row)] for row in rows]) for m, rows in by_m.items()]


def _optimum(rows: Sequence[LinkRow]) -> float:
    return middle(next(row.f_m for row in rows if row.name == GCO and row.m is None))


def _order(m: int, rows: Sequence[LinkRow], optima: Sequence[float]) -> Order:
    ratios = [middle(row.f_m) / optimum for row, optimum in zip(rows, optima, strict=True)]
    return Order(
        m=m,
        name=rows[0].name,
        excess_percent=merge([100 * max(LEAST, ratio - 1) for ratio in ratios]),
        f_m=merge([row.f_m for row in rows]),
        f_m_over_optimum=merge(ratios),
        reaches_optimum=share([ratio <= 1 + AT_OPTIMUM for ratio in ratios]),
        rank_of_C=ranks(rows),
        conservative=share([bool(row.conservative) for row in rows]),
        eigenvalues=merge([eigenvalues(row.matrix)[1].tolist() for row in rows]),
        prediction=merge([row.prediction for row in rows]),
    )


def share(truths: Sequence[bool]) -> float:
    """Share of the draws in which something holds."""
    return sum(truths) / len(truths)


def ranks(rows: Sequence[LinkRow]) -> dict[str, int]:
    """Draws by rank of C."""
    found = [row.rank_of_C for row in rows]
    return {str(rank): found.count(rank) for rank in sorted(set(found))}


def sure(order: Sequence[Order]) -> list[int]:
    """Orders that reach the optimum in every draw."""
    return [row.m for row in order if row.reaches_optimum == 1]


def which_m(order: Sequence[Order], allowed: tuple[float, float], draws: int) -> str:
    """Which order to take, and what the other ones that Eq. (20) allows do."""
    safe = sure(order)
    first = (
        f"Take m = {min(safe)}, the least that reaches the certified optimum of F_M in all {draws} draws."
        if safe
        else f"No order m reaches the certified optimum of F_M in all {draws} draws."
    )
    others = [
        f"m = {row.m} reaches it in {100 * row.reaches_optimum:.0f} %: {_excess(row)}, "
        f"position error {middle(row.prediction.position_rms_um):.1f} um."
        for row in order
        if row.m >= allowed[0] and row.m not in safe
    ]
    return " ".join([first, f"Eq. (20) allows {allowed[0]:g} to {allowed[1]:g}.", *others])


def _excess(row: Order) -> str:
    low, high = ends(row.excess_percent)
    return f"F_M is {low:.0f} to {high:.0f} % above it"

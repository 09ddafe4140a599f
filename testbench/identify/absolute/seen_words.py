"""What is hidden, in as few sentences as say it."""

from collections.abc import Sequence

from testbench.identify.absolute.seen import Hidden

ERROR = "'s error of "  #: Between a joint and the orders of its periodic errors.
FEW = 2  #: Bands of one joint's errors that are named one by one.


def sentences(found: Sequence[Hidden]) -> tuple[str, ...]:
    """One sentence an advice for what is not seen, one for errors of a joint among themselves."""
    said = [one.words for one in found if one.kind == "structural"]
    behind = [one for one in found if one.kind == "behind"]
    said += [one.words for one in behind if not _among_themselves(one)]
    said += [_mutual(own) for own in _grouped([one for one in behind if _among_themselves(one)])]
    unseen = [one for one in found if one.kind == "unseen"]
    for advice in dict.fromkeys(one.advice for one in unseen):
        said.append(_unseen([one for one in unseen if one.advice == advice]))
    return tuple(said)


def _joint(name: str) -> str:
    """The joint of a periodic error, nothing for other quantities."""
    return name.split(ERROR)[0] if ERROR in name else ""


def _among_themselves(one: Hidden) -> bool:
    """Whether a joint's error hides behind others of the same joint alone."""
    return bool(_joint(one.what)) and all(_joint(name) == _joint(one.what) for name in one.behind)


def _grouped(found: Sequence[Hidden]) -> list[list[Hidden]]:
    """By joint and advice, in their order."""
    keys = dict.fromkeys((_joint(one.what), one.advice) for one in found)
    return [[one for one in found if (_joint(one.what), one.advice) == key] for key in keys]


def _mutual(own: Sequence[Hidden]) -> str:
    if len(own) == 1:
        return own[0].words
    orders = ", ".join(one.what.split(ERROR)[1].removeprefix("orders ").removeprefix("order ") for one in own)
    joint = _joint(own[0].what)
    return f"{joint}'s errors of orders {orders} hide behind each other ({_left(own)}){_then(own[0])}"


def _unseen(own: Sequence[Hidden]) -> str:
    if len(own) == 1:
        return own[0].words
    names: list[str] = []
    for group in _grouped(own):
        if not _joint(group[0].what) or len(group) <= FEW:
            names += [one.what for one in group]
        else:
            names.append(f"{len(group)} bands of {_joint(group[0].what)}'s errors")
    return f"{', '.join(names)} are not seen ({_left(own)}){_then(own[0])}"


def _left(own: Sequence[Hidden]) -> str:
    shares = [100 * one.share for one in own]
    return f"{min(shares):.0f} to {max(shares):.0f} % of their prior variance left"


def _then(one: Hidden) -> str:
    return one.advice and f": {one.advice}"

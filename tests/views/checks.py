"""What every study's views must hold: what people see equals the report, number by number, unit by unit.

The checks read what was written (Markdown, a terminal's table, a figure's artists). They know the report by
paths such as "check.rms_mm" that the tests write down themselves: a column with a wrong key shows.
"""

import re
from collections.abc import Mapping

import numpy as np
import pytest

from testbench.runs.spread import Spread

UNITS = {
    "mm": 1e-3, "um": 1e-6, "m": 1.0, "%": 1e-2, "s": 1.0, "ms": 1e-3, "kg": 1.0, "N": 1.0, "deg": 1.0,
    "mrad": 1e-3, "urad": 1e-6, "kN": 1e3, "ppm": 1e-6, "10^-6 SI": 1e-6, "um/N": 1e-6, "um/(N m)": 1e-6,
    "urad/N": 1e-6, "urad/(N m)": 1e-6,
}  # fmt: skip
"""What a unit is in SI."""
WORDS = {"percent": "%", "seconds": "s"}
"""Last words of a field's name that are units by another name; those that are no unit have none."""


def at(row, path):
    """The report's value at a path of fields, keys and places; None where a part of it is None."""
    for part in path.split("."):
        if isinstance(row, list | tuple):
            row = row[int(part)]
        else:
            row = row[part] if isinstance(row, Mapping) else getattr(row, part)
        if row is None:
            return None
    return row


def unit_of(path):
    """The unit that a field's name promises, empty for none."""
    name = path.split(".")[-1]
    over, _, below = name.partition("_per_")
    if below in ("N", "Nm"):
        return f"{over.split('_')[-1]}/{'(N m)' if below == 'Nm' else below}"
    *words, last = name.removesuffix("_to_1_percent").split("_")
    unit = WORDS.get(last, last)
    return unit if (words or last == "seconds") and unit in UNITS and name != "f_m" else ""


def tables_of(text):
    """Tables of a Markdown text: headings and rows of cells, without bold marks."""
    found = []
    for block in re.findall(r"(?:^\|.*\|$\n?)+", text, re.MULTILINE):
        head, _, *rows = (
            [c.strip().replace(r"\|", "|") for c in re.split(r"(?<!\\)\|", line)[1:-1]]
            for line in block.splitlines()
        )
        found.append((head, [[c.removeprefix("**").removesuffix("**") for c in row] for row in rows]))
    return found


MOST_WORDS, MOST_SENTENCES, MOST_STATEMENTS = 25, 2, 5
"""Of a sentence, of the answer, of the list below it."""
INTERVAL = r"\([^()]*\d to \d[^()]*\)"  #: What stands behind a number; it is no word.
FORBIDDEN = {
    "a goal": r"\b[Aa]ims?\b|\b[Bb]ars?\b|\b[Mm]issed\b|MISSED",
    "a power of ten": r"\d[eE][+-]?\d",
    "a key of the report": r"\b[a-z]+\d*(?:_[a-z0-9]+)+\b|\w_mm\b",
    "the unit 1": r"\[1\]|, 1 \|",
}
"""What no reader is shown: goals belong to tests, keys to report.json."""
NAMES = (
    r"`[^`]*`|!?\[[^]]*\]\([^)]*\)|\b[\w.]+\.(?:csv|json|png|md|npz|xml|toml)\b"
    r"|\bkr500_l480\b|\barm_6r\b|\b(?:link|joint|wrist|phi|shoulder|elbow)_\w+"
)
"""Commands, files, arms and joints, whose names may look like keys."""


def sentences(text):
    """Sentences of Markdown, bullets each by itself."""
    plain = re.sub(r"\b(Eqs?|No|Fig)\. ", r"\1.~", re.sub(r"[*`]", "", text))
    lines = [line.strip().removeprefix("- ") for line in plain.splitlines() if line.strip()]
    return [s for line in lines for s in re.split(r"(?<=[.?!])\s+(?=[^a-z\s])", line)]


def word_faults(blocks, whole):
    """What is wrong with the words of a report, a line each: their length, their number, what they hold.

    Args:
        blocks: Its answer, where it is worst, and its statements, by name.
        whole: The page.
    """
    bullets = [line for line in blocks["statements"].splitlines() if line.startswith("- ")]
    said = [s for text in blocks.values() for s in sentences(text)]
    found = [
        f"{n} words: {s}"
        for s in said
        if (n := sum(bool(re.search(r"\w", word)) for word in re.sub(INTERVAL, "", s).split())) > MOST_WORDS
    ]
    if len(sentences(blocks["answer"])) > MOST_SENTENCES:
        found.append(f"more than {MOST_SENTENCES} sentences: {blocks['answer']}")
    if len(bullets) > MOST_STATEMENTS:
        found.append(f"{len(bullets)} statements")
    lines = [line for line in whole.splitlines() if line.startswith("- ")]
    found += [f"said twice: {s}" for s in {*said, *lines} if said.count(s) > 1 or lines.count(s) > 1]
    plain = re.sub(NAMES, "", whole)
    return found + [
        f"{what}: {plain[max(m.start() - 30, 0) : m.end() + 10]!r}"
        for what, pattern in FORBIDDEN.items()
        for m in re.finditer(pattern, plain)
    ]


def check_words(words):
    """The words of a report are as short as a reader's time, and hold nothing that is not for readers."""
    blocks = {name: words.block(name) for name in ("answer", "worst", "statements")}
    faults = word_faults(blocks, words.whole())
    assert not faults, "\n".join(faults)


def check_markdown(text):
    """The same of a report.md: its first bold paragraph is the answer, then come the worst and a list."""
    parts = [part.strip() for part in text.split("\n\n")]
    first = next((k for k, part in enumerate(parts) if part.startswith("**")), len(parts))
    parts += [""] * 3
    names = dict(zip(("answer", "worst", "statements"), [*parts[first : first + 3], "", ""], strict=False))
    blocks = {"answer": names["answer"].strip("*")} | {
        name: names[name]
        if names[name].startswith("- ") == (name == "statements") and not names[name].startswith(("|", "#"))
        else ""
        for name in ("worst", "statements")
    }
    faults = word_faults(blocks, text)
    assert not faults, "\n".join(faults)


def curves(axes):
    """Lines of an axes by label: x and y as drawn."""
    lines = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
    return {line.get_label(): tuple(np.asarray(data, float) for data in line.get_data()) for line in lines}


def bands(axes):
    """Shaded spreads in the order in which they were drawn: rows of x, low and high."""
    found = []
    for band in axes.collections:
        corners = band.get_paths()[0].vertices
        x = np.unique(corners[:, 0])
        found.append([(v, *np.sort(np.unique(corners[corners[:, 0] == v, 1]))[[0, -1]]) for v in x])
    return found


def unit_in(label):
    """The unit in square brackets at the end of an axis label, as tables write it."""
    return re.fullmatch(r".*\[(.*)\]", label).group(1).replace("µ", "u")


def key_of(figure):
    """The legend of all axes of a figure."""
    [found] = [legend for part in (figure, *figure.subfigs) for legend in part.legends]
    return found


def looks_differ(legend):
    """No two entries of a legend look alike: colour, line and marker."""
    seen = [
        (h.get_color(), h.get_linestyle(), h.get_marker(), h.get_markerfacecolor())
        for h in legend.legend_handles
    ]
    assert len(set(seen)) == len(seen), seen


def check_spread(spread, values):
    """A spread is median and percentiles of these numbers, or the one that all of them are."""
    if not isinstance(spread, Spread):
        assert set(values) == {spread}
        return
    p05, median, p95 = np.percentile(values, [5, 50, 95])
    assert (spread.p05, spread.median, spread.p95) == pytest.approx((p05, median, p95))

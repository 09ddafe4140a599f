"""Workbooks as spreadsheets write them, made of their parts."""

import io
import zipfile
from collections.abc import Mapping, Sequence

Cell = str | float | None
BEGIN = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>'
MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
LINK = f'xmlns:r="{OFFICE}"'
STYLES = (
    f"{BEGIN}<styleSheet {MAIN}>"
    '<numFmts><numFmt numFmtId="164" formatCode="yyyy\\-mm\\-dd\\ hh:mm:ss"/>'
    '<numFmt numFmtId="165" formatCode="[Red]0.000&quot; mm days&quot;"/></numFmts>'
    '<cellStyleXfs><xf numFmtId="14"/></cellStyleXfs>'
    '<cellXfs><xf numFmtId="0"/><xf numFmtId="164"/><xf numFmtId="165"/><xf numFmtId="14"/></cellXfs>'
    "</styleSheet>"
)
"""Styles of cells: 0 general, 1 date and time, 2 millimetres with a word, 3 a date."""


def column(k: int) -> str:
    """Letters of a column, counted from 0."""
    return (column(k // 26 - 1) if k >= 26 else "") + chr(ord("A") + k % 26)


def sheet(rows: Sequence[Sequence[Cell]], words: list[str]) -> str:
    """A sheet; texts are among the words that all share. A text that begins with < is the cell itself."""
    lines = []
    for i, row in enumerate(rows, start=1):
        cells = []
        for k, value in enumerate(row):
            place = f"{column(k)}{i}"
            if isinstance(value, str) and value.startswith("<"):
                cells.append(value.replace("<c", f'<c r="{place}"', 1))
            elif isinstance(value, str):
                words.append(value)
                cells.append(f'<c r="{place}" t="s"><v>{len(words) - 1}</v></c>')
            elif value is not None:
                cells.append(f'<c r="{place}"><v>{value!r}</v></c>')
        lines += [f'<row r="{i}">{"".join(cells)}</row>'] if cells else []
    return f"{BEGIN}<worksheet {MAIN}><sheetData>{''.join(lines)}</sheetData></worksheet>"


def parts(sheets: Mapping[str, Sequence[Sequence[Cell]]], hidden: Sequence[str] = ()) -> dict[str, str]:
    """The parts of a workbook by their names."""
    words: list[str] = []
    made, names, links = {}, [], []
    for k, (name, rows) in enumerate(sheets.items(), start=1):
        made[f"xl/worksheets/sheet{k}.xml"] = sheet(rows, words)
        state = ' state="hidden"' if name in hidden else ""
        names.append(f'<sheet name="{name}" sheetId="{k}"{state} r:id="rId{k}"/>')
        links.append(f'<Relationship Id="rId{k}" Type="x/worksheet" Target="worksheets/sheet{k}.xml"/>')
    made["xl/workbook.xml"] = f"{BEGIN}<workbook {MAIN} {LINK}><sheets>{''.join(names)}</sheets></workbook>"
    book = f'<Relationship Id="r" Type="{OFFICE}/officeDocument" Target="xl/workbook.xml"/>'
    made["_rels/.rels"] = f"{BEGIN}<Relationships>{book}</Relationships>"
    made["xl/_rels/workbook.xml.rels"] = f"{BEGIN}<Relationships>{''.join(links)}</Relationships>"
    texts = "".join(f"<si><t>{_escaped(word)}</t></si>" for word in words)
    made["xl/sharedStrings.xml"] = f"{BEGIN}<sst {MAIN}>{texts}</sst>"
    return made | {"xl/styles.xml": STYLES}


def packed(made: Mapping[str, str | bytes]) -> bytes:
    """The bytes of a workbook."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as book:
        for name, text in made.items():
            book.writestr(name, text)
    return file.getvalue()


def _escaped(word: str) -> str:
    return word.replace("&", "&amp;").replace("<", "&lt;")

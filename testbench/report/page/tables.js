"use strict";

/** An element with attributes and children; text is never taken as HTML. */
function make(tag, attributes = {}, ...children) {
  const svg = ["svg", "line", "circle", "rect", "path", "text", "g", "title"].includes(tag);
  const found = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) found.setAttribute(key, value);
  found.append(...children);
  return found;
}

/** What a cell is sorted by: its number, the first number in its text, or its text. */
function rank(cell) {
  if (cell.dataset.v !== undefined) return Number(cell.dataset.v);
  const number = /^[*\s]*([-+]?\d[\d,]*(\.\d+)?(e[-+]?\d+)?)/i.exec(cell.textContent);
  return number ? Number(number[1].replaceAll(",", "")) : cell.textContent.trim().toLowerCase();
}

/** Numbers before words, words by the alphabet; what has none ("-") comes last. */
function before(a, b) {
  const rest = (x) => (x === "-" || x === "" ? 2 : typeof x === "string" ? 1 : 0);
  if (rest(a) !== rest(b)) return rest(a) - rest(b);
  return typeof a === "number" ? a - b : a.localeCompare(b);
}

function sortBy(table, head, k) {
  const down = head.getAttribute("aria-sort") === "ascending";
  for (const other of head.parentElement.children) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const rows = [...table.tBodies[0].rows];
  rows.sort((a, b) => (down ? -1 : 1) * before(rank(a.cells[k]), rank(b.cells[k])));
  table.tBodies[0].append(...rows);
}

/** Every table is sorted by a click on a heading. */
function sortable(table) {
  [...(table.tHead ? table.tHead.rows[0].cells : [])].forEach((head, k) => {
    head.tabIndex = 0;
    head.addEventListener("click", () => sortBy(table, head, k));
    head.addEventListener("keydown", (e) => ["Enter", " "].includes(e.key) && (e.preventDefault(), sortBy(table, head, k)));
  });
}

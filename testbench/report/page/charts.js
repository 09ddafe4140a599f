"use strict";

const SOFT = "var(--soft)";

/** Ticks of an axis: 1, 2, 5 times powers of ten if logarithmic, else steps of one of them. */
function ticks(low, high, log) {
  const found = [];
  if (log) {
    for (let power = 10 ** Math.floor(Math.log10(low)); power <= high; power *= 10)
      for (const k of high / low < 100 ? [1, 2, 5] : [1]) if (k * power >= low && k * power <= high) found.push(k * power);
    return found;
  }
  const rough = (high - low) / 5 || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((k) => k * power >= rough) * power;
  for (let x = Math.ceil(low / step) * step; x <= high + 1e-9 * step; x += step) found.push(x);
  return found;
}

const plain = (x) => String(Number(x.toPrecision(3)));

const DEPTH = 3e3; // what is smaller than the largest by more is drawn at the end of a logarithmic axis

/** A scale from numbers to places; logarithmic where the largest is 20 times the smallest. */
function scale(numbers, from, to) {
  if (!numbers.length) return scale([0], from, to);
  let low = Math.min(...numbers), high = Math.max(...numbers);
  if (low > 0) low = Math.max(low, high / DEPTH);
  const log = low > 0 && high > 20 * low;
  if (log) [low, high] = [low / 1.2, high * 1.2];
  else [low, high] = [Math.min(0, low), high > 0 ? 1.08 * high : high === low ? low + 1 : 0];
  const f = log ? Math.log : (x) => x;
  const place = (x) => from + ((to - from) * (f(Math.max(x, low)) - f(low))) / (f(high) - f(low));
  return { place, ticks: ticks(low, high, log), log };
}

/** The dot of a model: its shape and colour, filled where it has a prior. */
function dot(x, y, look, size = 5) {
  const [s, fill] = [size, look.filled ? look.colour : "var(--card)"];
  const style = { fill, stroke: look.colour, "stroke-width": 2 };
  const corners = { D: [[0, -1.3], [1.3, 0], [0, 1.3], [-1.3, 0]], "^": [[0, -1.2], [1.2, 1], [-1.2, 1]], v: [[0, 1.2], [1.2, -1], [-1.2, -1]], s: [[-1, -1], [1, -1], [1, 1], [-1, 1]], P: [[-0.5, -1.2], [0.5, -1.2], [0.5, -0.5], [1.2, -0.5], [1.2, 0.5], [0.5, 0.5], [0.5, 1.2], [-0.5, 1.2], [-0.5, 0.5], [-1.2, 0.5], [-1.2, -0.5], [-0.5, -0.5]] }[look.mark];
  if (!corners) return make("circle", { cx: x, cy: y, r: s, ...style });
  const path = corners.map(([a, b]) => `${x + s * a} ${y + s * b}`).join("L");
  return make("path", { d: `M${path}Z`, ...style });
}

const PLAIN = { colour: "#7f8a94", mark: "o", filled: true };

/** The columns of a table as dots with intervals, a row a line: a button a column, and one for all of them. */
function dotChart(place, table) {
  const columns = table.head.map((head, k) => (head.drawn ? k : -1)).filter((k) => k > 0);
  if (!columns.length) return;
  const heads = make("div", { class: "heads" });
  const picture = make("div");
  const show = (k) => {
    for (const button of heads.children) button.setAttribute("aria-pressed", button.dataset.k === String(k));
    const draw = k === 0 ? drawAll : drawColumn;
    note.textContent = [table.title, k && table.dots].filter(Boolean).join("; ");
    picture.replaceChildren(draw(table, k || columns, place.clientWidth || 600));
  };
  const button = (k, words) => {
    const found = make("button", { type: "button", "data-k": k }, words);
    found.addEventListener("click", () => show(k));
    heads.append(found);
  };
  const all = table.across && columns.length > 1;
  if (all) button(0, `by ${table.across}`);
  for (const k of columns) button(k, table.head[k].title);
  const note = make("p", { class: "note" });
  if (table.title || table.dots) place.append(note);
  place.append(heads, picture);
  const told = all && (stepsOf(table, columns).length > 1 || Object.keys(table.looks).length); // else dots are alike
  show(table.first > 0 ? table.first : told ? 0 : columns.at(-1));
}

/** Columns that are steps of a number. */
const stepsOf = (table, columns) => columns.filter((k) => /^-?[\d.]/.test(table.head[k].title));

/** All columns side by side, of steps of a number these alone, a line of dots a row; pointing brings it forward. */
function drawAll(table, drawn, width) {
  const steps = stepsOf(table, drawn), joined = steps.length > 1;
  const columns = joined ? steps : drawn;
  const rows = table.rows.filter((row) => columns.some((k) => row.cells[k].v !== undefined));
  const every = rows.flatMap((row) => columns.map((k) => row.cells[k].v)).filter((x) => x !== undefined);
  const names = rows.map((row) => row.cells[0].text);
  const right = Math.min(24 + Math.max(...names.map((name) => wide(table.words[name]))), 0.45 * width);
  const lines = names.map((name) => folded(table.words[name], right - 16)), step = lines.some((own) => own.length > 1) ? 29 : 15;
  const titles = columns.map((k) => table.head[k].title), long = 8 + Math.max(...titles.map(wide));
  const tilted = long > (width - right - 46) / columns.length; // too many words to stand side by side
  const bottom = tilted ? 20 + 0.7 * long : 24;
  const [left, top, height] = [46, 8, Math.max(290, (step + 2) * rows.length + 40) + bottom - 24];
  const y = scale(every, height - bottom, top);
  const at = (i) => left + ((width - left - right) * (i + 0.5)) / columns.length;
  const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": table.title || table.across });
  for (const tick of y.ticks) {
    svg.append(make("line", { class: "grid", x1: left, x2: width - right, y1: y.place(tick), y2: y.place(tick) }));
    svg.append(make("text", { class: "soft", x: left - 6, y: y.place(tick) + 4, "text-anchor": "end" }, plain(tick)));
  }
  titles.forEach((title, i) => {
    const place = tilted ? { transform: `translate(${at(i) + 4} ${height - bottom + 16}) rotate(-45)`, "text-anchor": "end" } : { x: at(i), y: height - 6, "text-anchor": "middle" };
    svg.append(make("text", { class: "soft", ...place }, title));
  });
  const ends = apart(rows.map((row) => y.place(columns.map((k) => row.cells[k].v).findLast((x) => x !== undefined))), step, top + 6, height - bottom - 6);
  const order = [...rows.keys()].sort((a, b) => rows[a].marked - rows[b].marked); // the winner on top
  order.forEach((r) => svg.append(drawRow(rows[r], table.looks[names[r]] || PLAIN, { columns, joined, at, y, end: ends[r], x: width - right + 14, lines: lines[r] })));
  return svg;
}

/** One row of a table as dots over its columns, joined where the columns are steps of a number. */
function drawRow(row, look, { columns, joined, at, y, end, x, lines }) {
  const group = make("g", { class: "row" });
  const dots = columns.map((k, i) => [row.cells[k], at(i)]).filter(([cell]) => cell.v !== undefined);
  const path = dots.map(([cell, here]) => `${here} ${y.place(cell.v)}`).join("L");
  if (joined && dots.length > 1) group.append(make("path", { d: `M${path}`, fill: "none", stroke: look.colour, "stroke-width": row.marked ? 3 : 1.5, opacity: row.marked ? 1 : 0.55 }));
  const last = dots.at(-1);
  group.append(make("line", { x1: last[1] + 8, y1: y.place(last[0].v), x2: x - 4, y2: end, stroke: "var(--line)" }));
  for (const [cell, here] of dots) {
    const mark = dot(here, y.place(cell.v), look, row.marked ? 6 : 4.5);
    mark.append(make("title", {}, `${row.cells[0].text}: ${cell.text}`));
    group.append(mark);
  }
  const title = `${row.cells[0].text}: ${dots.map(([cell]) => cell.text).join(", ")}`;
  group.append(...named(lines, title, { x, y: end, "font-weight": row.marked ? "700" : "400" }));
  return group;
}

/** Places moved apart until each is at least a step from the next, within limits. */
function apart(places, step, low, high) {
  const order = [...places.keys()].sort((a, b) => places[a] - places[b]);
  const out = [...places];
  order.forEach((k, i) => (out[k] = Math.max(out[k], i ? out[order[i - 1]] + step : low)));
  for (let i = order.length - 1, top = high; i >= 0; i--) {
    out[order[i]] = Math.min(out[order[i]], top);
    top = out[order[i]] - step;
  }
  return out;
}

const LETTERS = document.createElement("canvas").getContext("2d");
LETTERS.font = "700 12px system-ui, sans-serif";

/** How wide a text is, bold. */
const wide = (text) => LETTERS.measureText(text).width;

/** A text, or its beginning that is no wider. */
function fitted(text, most) {
  if (wide(text) <= most) return text;
  let end = text.length;
  while (end && wide(`${text.slice(0, end)}\u2026`) > most) end--;
  return `${text.slice(0, end)}\u2026`;
}

/** A text in one line, or in two that are no wider, parted between words. */
function folded(text, most) {
  if (wide(text) <= most) return [text];
  const words = text.split(" ");
  let count = words.length;
  while (count > 1 && wide(words.slice(0, count).join(" ")) > most) count--;
  const [first, second] = [words.slice(0, count).join(" "), words.slice(count).join(" ")];
  return [fitted(first, most), ...(second ? [fitted(second, most)] : [])];
}

/** The lines of a name about a height, and what is said when they are pointed at. */
function named(lines, title, { y, ...style }) {
  return lines.map((line, n) => {
    const found = make("text", { ...style, y: y + 4 + 13 * (n - (lines.length - 1) / 2) }, line);
    found.append(make("title", {}, title));
    return found;
  });
}

/** Rows with a number in a column: the winner first, then by size; steps keep their order. */
function sortedRows(table, k) {
  const rows = table.rows.filter((row) => row.cells[k].v !== undefined);
  return table.stepwise ? rows : rows.sort((a, b) => b.marked - a.marked || a.cells[k].v - b.cells[k].v);
}

function drawColumn(table, k, width) {
  const rows = sortedRows(table, k);
  const names = rows.map((row) => row.cells[0].text);
  const most = Math.max(0.42 * width, Math.min(200, 0.55 * width)) - 14, left = 14 + Math.min(most, Math.max(...names.map((name) => wide(table.words[name]))));
  const lines = names.map((name) => folded(table.words[name], most));
  const [line, top, right] = [lines.some((own) => own.length > 1) ? 30 : 21, 6, 74];
  const height = top + line * rows.length + 22;
  const every = rows.flatMap((row) => ["v", "low", "high"].map((key) => row.cells[k][key]).concat(row.cells[k].dots).filter((x) => x !== undefined));
  if (table.head[k].ratio) every.push(1);
  const x = scale(every, left, width - right);
  const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": table.head[k].title });
  let free = -Infinity; // where the next number has room
  for (const tick of x.ticks) {
    svg.append(make("line", { class: "grid", x1: x.place(tick), x2: x.place(tick), y1: top, y2: height - 20 }));
    const half = wide(plain(tick)) / 2;
    if (x.place(tick) - half < free) continue;
    free = x.place(tick) + half + 4;
    svg.append(make("text", { class: "soft", x: x.place(tick), y: height - 6, "text-anchor": "middle" }, plain(tick)));
  }
  if (table.head[k].ratio) svg.append(make("line", { x1: x.place(1), x2: x.place(1), y1: top, y2: height - 20, stroke: SOFT, "stroke-dasharray": "2 3" }));
  rows.forEach((row, i) => {
    const [cell, y, look] = [row.cells[k], top + line * (i + 0.5), table.looks[names[i]] || PLAIN];
    const weight = row.marked ? "700" : "400";
    svg.append(...named(lines[i], `${names[i]}: ${cell.text}`, { x: left - 10, y, "text-anchor": "end", "font-weight": weight }));
    (cell.dots || []).forEach((value, n) => {
      const aside = cell.few ? 0 : 0.5 * 21 * (((0.618 * n) % 1) - 0.5); // trials of one number do not hide each other
      svg.append(cell.few ? dot(x.place(value), y, look, row.marked ? 6 : 4.5) : make("circle", { class: "trial", cx: x.place(value), cy: y + aside, r: 1.7, fill: look.colour, opacity: 0.4 }));
    });
    if (cell.low !== undefined && cell.high > cell.low)
      svg.append(make("line", { x1: x.place(cell.low), x2: x.place(cell.high), y1: y, y2: y, stroke: look.colour, "stroke-width": 3 }));
    if (!cell.few) {
      const mark = dot(x.place(cell.v), y, look, row.marked ? 6 : 4.5);
      mark.append(make("title", {}, `${names[i]}: ${cell.text}`));
      svg.append(mark);
    }
    const number = cell.text.split(" ")[0];
    svg.append(make("text", { x: width - right + 12, y: y + 4, "font-weight": weight }, number));
  });
  return svg;
}

/** A number with its interval. */
function said(line, k) {
  const [value, low, high] = [line.values, ...(line.ends || [])].map((own) => (own[k] === null ? "-" : own[k].toFixed(3)));
  return low === undefined || low === "-" ? value : `${value} (${low} to ${high})`;
}

/** A number a pose and model; hovering reads them, a click shows the arm there. */
function runChart(place, chart, names, choose) {
  const labels = chart.labels.map((label) => fitted(label, 110));
  const [width, height, left, bottom] = [Math.max(place.clientWidth, 320), 246, 44, 40];
  const n = names.length;
  const order = [...names.keys()];
  const size = (k) => Math.max(...chart.lines.map((line) => line.values[k] ?? 0));
  const every = chart.lines.flatMap((line) => [line.values, ...(line.ends || [])].flat()).filter((x) => x !== null);
  const y = scale(chart.limit === null ? every : [...every, chart.limit], height - bottom, 8);
  const at = (i) => left + ((width - left - 10) * (i + 0.5)) / n;
  const tip = make("div", { class: "tip" }, "To read the numbers of a pose, point at it or press the arrow keys. To see the arm there, click it or press Enter.");
  const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", tabindex: 0, "aria-label": `${chart.title}; arrows read it, Enter shows the arm` });
  const legend = make("div", { class: "bar" });
  for (const line of chart.lines) legend.append(swatch(line));
  if (chart.limit !== null) legend.append(make("span", { class: "named" }, dashes(), chart.limit_is));
  const sorted = make("button", { type: "button" }, "worst first");
  legend.append(sorted);

  const draw = () => {
    svg.replaceChildren();
    for (const tick of y.ticks) {
      svg.append(make("line", { class: "grid", x1: left, x2: width, y1: y.place(tick), y2: y.place(tick) }));
      svg.append(make("text", { class: "soft", x: left - 6, y: y.place(tick) + 4, "text-anchor": "end" }, plain(tick)));
    }
    if (chart.limit !== null) {
      const level = y.place(chart.limit);
      svg.append(make("line", { x1: left, x2: width, y1: level, y2: level, stroke: SOFT, "stroke-dasharray": "5 4" }));
    }
    const radius = Math.max(2, Math.min(4.5, width / n / 3));
    order.forEach((k, i) => chart.lines.forEach((line) => {
      if (line.values[k] === null) return;
      const [low, high] = (line.ends || []).map((end) => end[k]);
      if (low != null && high != null) svg.append(make("line", { x1: at(i), x2: at(i), y1: y.place(low), y2: y.place(high), stroke: line.colour, "stroke-width": Math.min(2.5, radius), opacity: 0.6 }));
      svg.append(dot(at(i), y.place(line.values[k]), line, radius));
    }));
    const every = Math.ceil((n * (Math.max(...labels.map(wide)) + 14)) / (width - left));
    let free = -Infinity; // where the next label has room
    order.forEach((k, i) => {
      const half = wide(labels[k]) / 2, x = Math.min(at(i), width - half);
      if (i % every || x - half < free) return;
      free = x + half + 6;
      svg.append(make("text", { class: "soft", x, y: height - 22, "text-anchor": "middle" }, labels[k]));
    });
    svg.append(make("text", { class: "across soft", x: (left + width) / 2, y: height - 5, "text-anchor": "middle" }, chart.across));
  };
  const nearest = (event) => {
    const box = svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * width;
    return Math.max(0, Math.min(n - 1, Math.floor(((x - left) / (width - left - 10)) * n)));
  };
  const cursor = make("line", { class: "chosen", y1: 4, y2: height - bottom });
  let pointed = -1;
  const point = (i) => {
    pointed = i;
    const k = order[i], texts = chart.lines.map((line) => `${line.words} ${said(line, k)}`);
    tip.textContent = `${names[k]}: ${texts.join(", ")}`;
    cursor.setAttribute("x1", at(i));
    cursor.setAttribute("x2", at(i));
    svg.append(cursor);
  };
  svg.addEventListener("pointermove", (event) => point(nearest(event)));
  svg.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1, Home: -n, End: n }[event.key];
    if (step) (event.preventDefault(), point(Math.max(0, Math.min(n - 1, pointed + step))));
    else if (event.key === "Enter" && pointed >= 0) choose(chart.group, order[pointed]);
  });
  svg.addEventListener("click", (event) => choose(chart.group, order[nearest(event)]));
  sorted.addEventListener("click", () => {
    const worst = sorted.getAttribute("aria-pressed") !== "true";
    sorted.setAttribute("aria-pressed", worst);
    order.sort((a, b) => (worst ? size(b) - size(a) : a - b));
    draw();
  });
  draw();
  place.append(legend, svg, tip);
}

/** The dashed line of a level. */
function dashes() {
  const line = make("line", { x1: 0, x2: 20, y1: 8, y2: 8, stroke: SOFT, "stroke-dasharray": "5 4" });
  return make("svg", { viewBox: "0 0 20 16", style: "width:20px;height:16px" }, line);
}

/** Name of a line with its dot. */
function swatch(line) {
  const mark = make("svg", { viewBox: "0 0 16 16", style: "width:16px;height:16px" }, dot(8, 8, line));
  return make("span", { class: "named" }, mark, line.words);
}

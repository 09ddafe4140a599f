"use strict";

/** Errors all over the workspace: one pane a model, one camera and one scale of colours for all. */
class Maps {
  constructor(place, data, ramp, choose) {
    Object.assign(this, { data, ramp, choose, panes: [] });
    const every = data.lines.flatMap((line) => line.values).filter((x) => x !== null);
    [this.low, this.high] = [Math.min(...every), Math.max(...every)];
    this.log = this.low > 0 && this.high > 20 * this.low;
    this.camera = Camera.around([0, 0, 0, ...data.at.filter((at) => at).flat()]);
    const panes = make("div", { class: "panes" });
    for (const line of data.lines) panes.append(this.pane(line));
    if (data.difference) panes.append(this.difference(...data.difference.map((k) => data.lines[k])));
    place.append(panes, this.key());
  }

  share(value) {
    const f = this.log ? Math.log : (x) => x;
    return this.high > this.low ? (f(value) - f(this.low)) / (f(this.high) - f(this.low)) : 0;
  }

  colour(share) {
    const at = share * (this.ramp.length - 1), k = Math.min(Math.floor(at), this.ramp.length - 2);
    const mix = this.ramp[k].map((x, c) => Math.round(x + (at - k) * (this.ramp[k + 1][c] - x)));
    return `rgb(${mix.join(",")})`;
  }

  pane(line) {
    const canvas = make("canvas", { "aria-label": `Errors of ${line.words} over the workspace` });
    const worst = line.values.reduce((best, x, k) => (x !== null && this.data.at[k] && (best < 0 || x > line.values[best]) ? k : best), -1);
    const pane = { canvas, line, worst };
    this.panes.push(pane);
    const redraw = () => this.panes.forEach((own) => this.ask(own));
    turnable(canvas, this.camera, redraw, (event) => this.pick(pane, event));
    new ResizeObserver(() => this.ask(pane)).observe(canvas);
    const head = make("h3", {}, swatch(line));
    if (worst < 0) return make("div", { class: "pane" }, head, canvas);
    const button = make("button", { type: "button" }, `worst: ${plain(line.values[worst])} mm`);
    button.addEventListener("click", () => this.choose(this.data.group, worst));
    const where = this.data.at[worst].map((x, k) => `${"xyz"[k]} ${x.toFixed(2)}`).join(", ");
    return make("div", { class: "pane" }, head, canvas, make("div", { class: "bar" }, button, make("span", {}, `at ${where} m`)));
  }

  /** One model minus another: a ball in the colour of the one that errs less, larger for more. */
  difference(ours, theirs) {
    const name = "Which errs less";
    const values = ours.values.map((x, k) => (x === null || theirs.values[k] === null ? null : x - theirs.values[k]));
    const known = values.filter((x) => x !== null), most = Math.max(...known.map(Math.abs));
    const canvas = make("canvas", { "aria-label": `Errors of ${ours.words} minus those of ${theirs.words} over the workspace` });
    const pane = { canvas, line: { values }, worst: -1, look: (x) => [x <= 0 ? ours.colour : theirs.colour, most ? Math.abs(x) / most : 0] };
    this.panes.push(pane);
    turnable(canvas, this.camera, () => this.panes.forEach((own) => this.ask(own)), (event) => this.pick(pane, event));
    new ResizeObserver(() => this.ask(pane)).observe(canvas);
    const less = known.filter((x) => x < 0).length;
    const words = `${ours.words} errs less in ${less} of ${known.length} places; the largest ball: ${plain(most)} mm`;
    return make("div", { class: "pane" }, make("h3", {}, name), canvas, make("div", { class: "bar" }, swatch(ours), swatch(theirs), make("span", { class: "wraps" }, words)));
  }

  ask(pane) {
    if (pane.asked) return;
    pane.asked = true;
    requestAnimationFrame(() => {
      pane.asked = false;
      this.draw(pane);
    });
  }

  draw(pane) {
    const { canvas, line, worst } = pane, box = canvas.getBoundingClientRect();
    const ratio = Math.min(2, Math.max(1, window.devicePixelRatio));
    const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (!width || !height) return;
    Object.assign(canvas, { width, height });
    const pen = canvas.getContext("2d"), project = this.camera.projector(width, height);
    const places = new Float32Array(3 * this.data.at.length);
    this.data.at.forEach((at, k) => at && project(...at, places, 3 * k));
    const order = [...line.values.keys()].filter((k) => this.data.at[k]).sort((a, b) => places[3 * b + 2] - places[3 * a + 2]);
    for (const k of order) {
      const [x, y, depth] = places.slice(3 * k, 3 * k + 3), value = line.values[k];
      const [colour, share] = value === null ? ["", 0] : pane.look ? pane.look(value) : [this.colour(this.share(value)), this.share(value)];
      const radius = ((0.9 * this.camera.home.distance) / depth) * ratio * (3 + 6 * share);
      pen.beginPath();
      pen.arc(x, y, radius, 0, 7);
      if (value === null) (pen.strokeStyle = "#8a8f94", pen.lineWidth = 1.5 * ratio, pen.stroke());
      else (pen.fillStyle = colour, pen.fill());
    }
    this.foot(pen, project, ratio);
    if (worst >= 0) this.ring(pen, places, worst, ratio);
    pane.places = places;
    pane.ratio = ratio;
  }

  /** Where the arm stands: a cross on the floor. */
  foot(pen, project, ratio) {
    const out = new Float32Array(6);
    pen.strokeStyle = getComputedStyle(document.body).getPropertyValue("--soft");
    pen.lineWidth = 3 * ratio;
    const s = this.camera.home.distance / 16;
    for (const [a, b] of [[[-s, 0, 0], [s, 0, 0]], [[0, -s, 0], [0, s, 0]], [[0, 0, 0], [0, 0, 1.6 * s]]]) {
      project(...a, out, 0);
      project(...b, out, 3);
      pen.beginPath();
      pen.moveTo(out[0], out[1]);
      pen.lineTo(out[3], out[4]);
      pen.stroke();
    }
  }

  ring(pen, places, worst, ratio) {
    const [x, y] = [places[3 * worst], places[3 * worst + 1]];
    pen.strokeStyle = inks().ink;
    pen.lineWidth = 2 * ratio;
    pen.beginPath();
    pen.arc(x, y, 13 * ratio, 0, 7);
    pen.stroke();
    pen.font = `${12 * ratio}px system-ui, sans-serif`;
    const size = pen.measureText("worst").width, right = x + 16 * ratio + size < pen.canvas.width;
    written(pen, "worst", right ? x + 16 * ratio : x - 16 * ratio - size, y + 4 * ratio, ratio);
  }

  pick(pane, event) {
    const box = pane.canvas.getBoundingClientRect();
    const [x, y] = [(event.clientX - box.left) * pane.ratio, (event.clientY - box.top) * pane.ratio];
    let best = -1, least = 14 * pane.ratio;
    this.data.at.forEach((at, k) => {
      if (!at) return;
      const far = Math.hypot(pane.places[3 * k] - x, pane.places[3 * k + 1] - y);
      if (far < least) [best, least] = [k, far];
    });
    if (best >= 0) this.choose(this.data.group, best);
  }

  key() {
    const stops = this.ramp.map((rgb) => `rgb(${rgb.join(",")})`).join(",");
    const [low, high] = [this.low, this.high];
    const middle = this.log ? Math.sqrt(low * high) : (low + high) / 2;
    const ramp = make("span", { class: "ramp", style: `background:linear-gradient(90deg,${stops})` });
    const ring = this.data.without ? `. Rings: ${this.data.without}` : "";
    if (low > high) return make("div", { class: "key" }, ring.slice(2));
    return make("div", { class: "key" }, `${plain(low)} mm`, ramp, `${plain(high)} mm`, ` (middle ${plain(middle)} mm${this.log ? ", logarithmic" : ""})${ring}`);
  }
}

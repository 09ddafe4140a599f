"use strict";

const BENT = [159, 85, 8];
const SHIFT = 40; // a body that bends by less than 4 mm is drawn once
const INSET = 2; // width over height of what is seen from near
const CLEAR = 1.004; // what is nearer by less is as near: surfaces that nearly coincide would show as stripes

/** The arm in its poses. */
class Scene {
  constructor(place, data) {
    this.canvas = place.querySelector("canvas");
    this.data = data;
    this.solids = data.solids.map((own) => ({ ...own, v: Float32Array.from(own.v, (part) => part / 1e4) }));
    this.rasters = [new Raster(), new Raster()];
    this.picture = document.createElement("canvas");
    this.hidden = new Set(data.groups.flatMap((group) => group.layers.filter((layer) => !layer.shown).map((layer) => layer.name)));
    this.camera = this.framed(data.groups[0], data.groups[0].first);
    this.insets = data.groups.filter((group) => group.near).map((group) => ({ group, camera: this.framed(group, 0, {}, INSET), canvas: make("canvas", { "aria-label": group.name }) }));
    if (this.insets.length) place.append(make("div", { class: "insets" }, ...this.insets.map(({ group, canvas }) => make("figure", {}, canvas, make("figcaption", {}, group.name)))));
    this.controls(place);
    turnable(this.canvas, this.camera, () => this.ask());
    new ResizeObserver(() => this.ask()).observe(this.canvas);
    this.show(0, data.groups[0].first);
  }

  /** All that is drawn of a pose, or what the eye is to be near to; x, y, z one after the other. */
  points(own, pose) {
    if (own.near) return own.near.at.flat();
    const points = [];
    for (const frames of [own.rigid, own.bent])
      if (frames) for (const solid of this.solids) for (const x of moved(solid.v, frames[pose], 7 * solid.body)) points.push(x);
    for (const layer of own.layers) {
      if (layer.kind === "specks") continue;
      for (const rows of [layer.at, layer.to]) if (rows) for (const part of ofPose(rows, pose)) if (part !== null) points.push(part / 1e4);
      if (layer.squares) for (const part of layer.squares) points.push(part / 1e4);
    }
    return points;
  }

  /** A camera that sees a pose of a group from an angle. */
  framed(own, pose, { yaw, pitch } = {}, aspect = 1) {
    return Camera.around(this.points(own, pose), own.near && yaw === undefined ? own.near.yaw : yaw, own.near && pitch === undefined ? own.near.pitch : pitch, aspect);
  }

  /** Whether a pose is in view as the camera stands. */
  sees(own, pose) {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight], out = new Float32Array(3);
    if (!width || !height) return false;
    const points = this.points(own, pose), project = this.camera.projector(width, height);
    for (let k = 0; k < points.length; k += 3) {
      project(points[k], points[k + 1], points[k + 2], out, 0);
      if (out[0] < 0 || out[0] > width || out[1] < 0 || out[1] > height) return false;
    }
    return true;
  }

  controls(place) {
    this.slider = make("input", { type: "range", min: 0, "aria-label": "pose" });
    this.says = make("div", { class: "says" });
    this.legend = make("div", { class: "bar legend" });
    const bar = make("div", { class: "bar" });
    if (this.data.groups.length > 1) {
      this.select = make("select", { "aria-label": "which poses" });
      this.data.groups.forEach((group, k) => this.select.append(make("option", { value: k }, group.name)));
      this.select.addEventListener("change", () => this.show(Number(this.select.value)));
      bar.append(this.select);
    }
    bar.append(this.slider);
    this.jumps = ["typical", "worst"].map((words) => make("button", { type: "button" }, words));
    this.jumps.forEach((own, k) => own.addEventListener("click", () => this.show(this.group, [this.data.groups[this.group].first, this.data.groups[this.group].worst][k])));
    bar.append(...this.jumps);
    this.slider.addEventListener("input", () => this.show(this.group, Number(this.slider.value)));
    place.append(bar, this.says, this.legend, make("div", { class: "says" }, this.data.title, make("span", { class: "screen" }, " Drag to turn, pinch or Ctrl and wheel to come near.")));
  }

  show(group, pose = this.data.groups[group].first) {
    const own = this.data.groups[group];
    if (group !== this.group) {
      this.legend.replaceChildren(...own.layers.map((layer) => this.toggle(layer)));
      this.slider.max = own.names.length - 1;
      for (const jump of this.jumps) jump.hidden = own.worst === null;
      if (this.select) this.select.value = group;
      const { target, distance, home } = this.framed(own, pose);
      Object.assign(this.camera, { target, distance, home }, own.near ? home : {});
    } else if (!this.sees(own, pose)) {
      const { target, distance } = this.framed(own, pose, this.camera);
      Object.assign(this.camera, { target, distance });
      this.camera.home.distance = distance;
    }
    [this.group, this.pose] = [group, pose];
    this.slider.value = pose;
    this.says.textContent = `${own.names[pose]}. ${own.words[pose]}`;
    this.ask();
  }

  toggle(layer) {
    const box = make("input", { type: "checkbox" });
    box.checked = !this.hidden.has(layer.name);
    box.addEventListener("change", () => {
      this.hidden[box.checked ? "delete" : "add"](layer.name);
      this.ask();
    });
    return make("label", {}, box, make("span", { class: "swatch", style: `background:${layer.colours ? `linear-gradient(90deg,${[...new Set(layer.colours)].concat(layer.colours[0]).join()})` : layer.colour}` }), layer.name);
  }

  /** Draw before the next picture, once. */
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.draw();
    });
  }

  draw() {
    const { pen, width, height, ratio } = cleared(this.canvas);
    if (!width || !height) return;
    const project = this.camera.projector(width, height);
    this.floor(pen, project);
    this.arm(pen, project, width, height);
    const own = this.data.groups[this.group];
    const taken = [];
    for (const layer of own.layers) if (!this.hidden.has(layer.name)) drawLayer(pen, project, layer, this.pose, ratio, taken);
    for (const inset of this.insets) this.inset(inset);
  }

  /** What is near in the pose shown, without the arm, which would hide it. */
  inset({ group, camera, canvas }) {
    const { pen, width, height, ratio } = cleared(canvas);
    if (!width || !height) return;
    const project = camera.projector(width, height), taken = [];
    for (const layer of group.layers) if (!this.hidden.has(layer.name)) drawLayer(pen, project, layer, Math.min(this.pose, group.names.length - 1), ratio, taken);
  }

  floor(pen, project) {
    pen.strokeStyle = getComputedStyle(document.body).getPropertyValue("--line");
    pen.lineWidth = 1;
    const reach = Math.ceil(this.camera.home.distance / 3);
    const out = new Float32Array(6);
    const line = (a, b) => {
      project(...a, out, 0);
      project(...b, out, 3);
      if (out[2] < 0.2 || out[5] < 0.2) return;
      pen.beginPath();
      pen.moveTo(out[0], out[1]);
      pen.lineTo(out[3], out[4]);
      pen.stroke();
    };
    for (let k = -reach; k <= reach; k++) {
      line([k, -reach, 0], [k, reach, 0]);
      line([-reach, k, 0], [reach, k, 0]);
    }
  }

  arm(pen, project, width, height) {
    const own = this.data.groups[this.group];
    const rigid = own.rigid[this.pose], bent = own.bent && own.bent[this.pose];
    const [right, up, back] = this.camera.axes();
    const light = [0, 1, 2].map((k) => 0.75 * back[k] + 0.25 * right[k] + 0.6 * up[k]);
    const frames = bent ? [rigid, bent] : [rigid];
    frames.forEach((frame, g) => {
      const raster = this.rasters[g];
      raster.resize(width, height);
      raster.clear();
      for (const solid of this.solids) {
        const at = 7 * solid.body;
        if (g && !shifted(rigid, frame, at)) continue;
        const points = moved(solid.v, frame, at), corners = new Float32Array(points.length);
        for (let k = 0; k < points.length; k += 3) project(points[k], points[k + 1], points[k + 2], corners, k);
        raster.fill(corners, solid.f, shading(points, solid.f, light, g ? 1 : 0.45 + 0.45 * solid.bright));
      }
    });
    this.blend(pen, width, height, Boolean(bent));
  }

  /** The rigid arm in grey, and before it the bent one in rust, half seen through. */
  blend(pen, width, height, bent) {
    const [a, b] = this.rasters;
    const image = new ImageData(width, height), pixels = image.data;
    for (let at = 0, k = 0; at < a.near.length; at++, k += 4) {
      const solid = a.near[at] > 0;
      if (solid) {
        pixels[k] = pixels[k + 1] = pixels[k + 2] = a.shade[at];
        pixels[k + 3] = 255;
      }
      if (bent && b.near[at] > 0) {
        const share = !solid || b.near[at] > CLEAR * a.near[at] ? 0.62 : 0.2, light = b.shade[at] / 255;
        for (let c = 0; c < 3; c++) pixels[k + c] = solid ? pixels[k + c] * (1 - share) + BENT[c] * light * share : BENT[c] * light;
        if (!solid) pixels[k + 3] = 255 * share;
      }
    }
    Object.assign(this.picture, { width, height });
    this.picture.getContext("2d").putImageData(image, 0, 0);
    pen.drawImage(this.picture, 0, 0);
  }
}

/** A canvas as large as it is on the screen, without what was drawn before. */
function cleared(canvas) {
  const box = canvas.getBoundingClientRect();
  const ratio = Math.min(2, Math.max(1, window.devicePixelRatio));
  const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, width, height);
  return { pen, width, height, ratio };
}

function shifted(rigid, bent, at) {
  for (let k = at; k < at + 7; k++) if (Math.abs(rigid[k] - bent[k]) > SHIFT) return true;
  return false;
}

/** The numbers of a pose, or those of all poses. */
function ofPose(rows, pose) {
  return rows[rows.length === 1 ? 0 : pose];
}

const DOTS = { dots: 4.5, specks: 1.6, trackers: 7 };
const WIDTHS = { lines: 1.5, weights: 1.5, tubes: 6, cylinders: 8, faces: 1.5 };

/** Dots, arrows or lines of one pose, over everything else. */
function drawLayer(pen, project, layer, pose, ratio, taken) {
  const from = ofPose(layer.at, pose), to = layer.to && ofPose(layer.to, pose), out = new Float32Array(6);
  for (let k = 0; k < from.length; k += 3) {
    if (from[k] === null || (to && to[k] === null)) continue;
    project(from[k] / 1e4, from[k + 1] / 1e4, from[k + 2] / 1e4, out, 0);
    if (to) project(to[k] / 1e4, to[k + 1] / 1e4, to[k + 2] / 1e4, out, 3);
    if (layer.semi_axes) {
      ellipsoid(pen, project, layer, k, ratio);
      continue;
    }
    const end = to && (layer.kind !== "arrows" || far(to, k) > far(from, k)) ? 3 : 0; // where the arm is not
    if (layer.labels.length && layer.kind === "weights") below(pen, project, to.slice(k, k + 3), layer, k / 3, ratio, taken);
    else if (layer.labels.length) written(pen, layer.labels[k / 3], out[end] + 7 * ratio, out[end + 1] - 5 * ratio, ratio, taken);
    pen.strokeStyle = pen.fillStyle = layer.colours ? layer.colours[k / 3] : layer.colour;
    pen.lineWidth = (WIDTHS[layer.kind] || 2.6) * ratio;
    pen.lineCap = layer.kind === "tubes" ? "round" : "butt";
    if (layer.squares) square(pen, project, layer.squares.slice(4 * k, 4 * k + 12));
    pen.beginPath();
    if (layer.kind in DOTS) {
      pen.arc(out[0], out[1], DOTS[layer.kind] * ratio, 0, 7);
      pen.fill();
      continue;
    }
    pen.moveTo(out[0], out[1]);
    pen.lineTo(out[3], out[4]);
    pen.stroke();
    if (layer.kind === "arrows" || layer.kind === "faces") head(pen, out, ratio);
    if (layer.kind === "weights") weight(pen, project, to.slice(k, k + 3).map((part) => part / 1e4), layer.radius);
  }
  if (layer.legs) tripods(pen, project, layer.legs, ratio);
}

/** The distance of the k-th number's place from the base. */
function far(numbers, k) {
  return Math.hypot(...numbers.slice(k, k + 3));
}

/** A plane face: a square that is seen through, by its four corners. */
function square(pen, project, corners) {
  const out = new Float32Array(12);
  for (let k = 0; k < 12; k += 3) project(corners[k] / 1e4, corners[k + 1] / 1e4, corners[k + 2] / 1e4, out, k);
  pen.beginPath();
  for (let k = 0; k < 12; k += 3) pen.lineTo(out[k], out[k + 1]);
  pen.closePath();
  pen.stroke();
  pen.globalAlpha = 0.25;
  pen.fill();
  pen.globalAlpha = 1;
}

/** The outline of an ellipsoid: the eye is far, so it is an ellipse by the shadows of the three semi-axes. */
function ellipsoid(pen, project, layer, k, ratio) {
  const centre = layer.at[0].slice(k, k + 3), axes = layer.semi_axes[k / 3], out = new Float32Array(12);
  const place = (own) => own.map((part) => part / 1e4);
  project(...place(centre), out, 0);
  for (let j = 0; j < 3; j++) project(...place(centre.map((part, i) => part + axes[3 * j + i])), out, 3 * j + 3);
  let [xx, xy, yy] = [0, 0, 0];
  for (let j = 3; j < 12; j += 3) {
    const [x, y] = [out[j] - out[0], out[j + 1] - out[1]];
    [xx, xy, yy] = [xx + x * x, xy + x * y, yy + y * y];
  }
  const half = (xx + yy) / 2, off = Math.hypot((xx - yy) / 2, xy);
  pen.strokeStyle = pen.fillStyle = layer.colour;
  pen.lineWidth = 1.2 * ratio;
  pen.beginPath();
  pen.ellipse(out[0], out[1], Math.sqrt(half + off), Math.sqrt(Math.max(0, half - off)), Math.atan2(2 * xy, xx - yy) / 2, 0, 7);
  pen.stroke();
  pen.globalAlpha = 0.25;
  pen.fill();
  pen.globalAlpha = 1;
}

/** A cylinder that hangs below a place, as high as wide. */
function weight(pen, project, [x, y, z], radius) {
  const out = new Float32Array(12);
  [[x, y, z], [x, y, z - 2 * radius], [x + radius, y, z], [x, y + radius, z]].forEach((place, k) => project(...place, out, 3 * k));
  const wide = Math.max(Math.hypot(out[6] - out[0], out[7] - out[1]), Math.hypot(out[9] - out[0], out[10] - out[1]));
  pen.beginPath();
  pen.ellipse(out[3], out[4], wide, 0.25 * wide, 0, 0, Math.PI);
  pen.ellipse(out[0], out[1], wide, 0.25 * wide, 0, Math.PI, 0);
  pen.fill();
}

/** The mass of a weight, written under its middle. */
function below(pen, project, [x, y, z], layer, which, ratio, taken) {
  const out = new Float32Array(3), text = layer.labels[which];
  project(x / 1e4, y / 1e4, z / 1e4 - 2 * layer.radius, out, 0);
  pen.font = `${12 * ratio}px system-ui, sans-serif`;
  written(pen, text, out[0] - pen.measureText(text).width / 2, out[1] + 20 * ratio, ratio, taken);
}

/** Legs of trackers, from their heads down. */
function tripods(pen, project, legs, ratio) {
  const out = new Float32Array(6);
  for (let k = 0; k < legs.length; k += 6) {
    project(legs[k] / 1e4, legs[k + 1] / 1e4, legs[k + 2] / 1e4, out, 0);
    project(legs[k + 3] / 1e4, legs[k + 4] / 1e4, legs[k + 5] / 1e4, out, 3);
    pen.lineWidth = 1.5 * ratio;
    pen.beginPath();
    pen.moveTo(out[0], out[1]);
    pen.lineTo(out[3], out[4]);
    pen.stroke();
  }
}

/** Colours of text and ground. */
function inks() {
  const style = getComputedStyle(document.body);
  return { ink: style.getPropertyValue("--ink"), card: style.getPropertyValue("--card") };
}

/** Text that is read over anything; left out where it would stand on other text, in boxes that are taken. */
function written(pen, text, x, y, ratio, taken = []) {
  const { ink, card } = inks();
  pen.font = `${12 * ratio}px system-ui, sans-serif`;
  const box = [x, y - 11 * ratio, x + pen.measureText(text).width, y];
  if (taken.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3])) return;
  taken.push(box);
  Object.assign(pen, { lineWidth: 3 * ratio, lineJoin: "round", strokeStyle: card, fillStyle: ink });
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
}

function head(pen, [x0, y0, , x1, y1], ratio) {
  const length = Math.hypot(x1 - x0, y1 - y0);
  if (length < 3) return;
  const size = Math.min(9 * ratio, 0.6 * length), [ux, uy] = [(x1 - x0) / length, (y1 - y0) / length];
  pen.beginPath();
  pen.moveTo(x1, y1);
  pen.lineTo(x1 - size * ux + 0.45 * size * uy, y1 - size * uy - 0.45 * size * ux);
  pen.lineTo(x1 - size * ux - 0.45 * size * uy, y1 - size * uy + 0.45 * size * ux);
  pen.fill();
}

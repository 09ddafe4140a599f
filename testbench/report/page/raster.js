"use strict";

const FOCAL = 1.8; // distance of the eye over half the width that it sees
const NEAR = 0.02; // what is nearer to the eye is not drawn [m]

/** A camera that turns about a target, z up; angles in rad, lengths in m. */
class Camera {
  constructor(target, distance, yaw = -0.9, pitch = 0.25) {
    Object.assign(this, { target, distance, yaw, pitch, home: { distance, yaw, pitch } });
  }

  /** A camera that has all points in view, x, y, z one after the other. */
  static around(points, yaw, pitch, aspect = 1) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    points.forEach((x, k) => ((low[k % 3] = Math.min(low[k % 3], x)), (high[k % 3] = Math.max(high[k % 3], x))));
    const camera = new Camera(low.map((x, k) => (x + high[k]) / 2), NEAR, yaw, pitch);
    const [right, up, back] = camera.axes(), along = (axis, p) => axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2];
    for (let k = 0; k < points.length; k += 3) {
      const p = camera.target.map((x, i) => points[k + i] - x);
      const needed = along(back, p) + 1.08 * FOCAL * Math.max(Math.abs(along(right, p)) / aspect, Math.abs(along(up, p)));
      camera.distance = Math.max(camera.distance, needed);
    }
    camera.home.distance = camera.distance;
    return camera;
  }

  /** Unit vectors of the picture: to the right, up, and from the target to the eye. */
  axes() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[-sy, cy, 0], [-cy * sp, -sy * sp, cp], [cy * cp, sy * cp, sp]];
  }

  /** A function from a point to its place in a picture and its distance from the eye. */
  projector(width, height) {
    const [right, up, back] = this.axes();
    const [tx, ty, tz] = this.target;
    const focal = FOCAL * Math.min(height, width) / 2;
    return (x, y, z, out, k) => {
      const [dx, dy, dz] = [x - tx, y - ty, z - tz];
      const depth = Math.max(this.distance - (back[0] * dx + back[1] * dy + back[2] * dz), NEAR / 2);
      out[k] = width / 2 + (focal * (right[0] * dx + right[1] * dy)) / depth;
      out[k + 1] = height / 2 - (focal * (up[0] * dx + up[1] * dy + up[2] * dz)) / depth;
      out[k + 2] = depth;
    };
  }
}

/** Triangles into pixels, the nearest in front; no graphics card is asked for. */
class Raster {
  resize(width, height) {
    if (this.width === width && this.height === height) return;
    [this.width, this.height] = [width, height];
    this.near = new Float32Array(width * height);
    this.shade = new Uint8Array(width * height);
  }

  clear() {
    this.near.fill(0);
  }

  /** Draw triangles seen from outside; corners as x, y, depth one after another. */
  fill(corners, faces, bright) {
    for (let f = 0; f < faces.length; f += 3) {
      const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
      const [ax, ay, bx, by, cx, cy] = [corners[a], corners[a + 1], corners[b], corners[b + 1], corners[c], corners[c + 1]];
      const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
      if (area >= 0) continue; // seen from behind: y points down in a picture
      if (Math.min(corners[a + 2], corners[b + 2], corners[c + 2]) < NEAR) continue;
      this.triangle([ax, ay, 1 / corners[a + 2]], [bx, by, 1 / corners[b + 2]], [cx, cy, 1 / corners[c + 2]], area, bright[f / 3]);
    }
  }

  triangle([ax, ay, az], [bx, by, bz], [cx, cy, cz], area, bright) {
    const { width, height, near, shade } = this;
    const left = Math.max(0, Math.ceil(Math.min(ax, bx, cx) - 0.5)), right = Math.min(width - 1, Math.floor(Math.max(ax, bx, cx) - 0.5));
    const top = Math.max(0, Math.ceil(Math.min(ay, by, cy) - 0.5)), bottom = Math.min(height - 1, Math.floor(Math.max(ay, by, cy) - 0.5));
    const zx = ((bz - az) * (cy - ay) - (cz - az) * (by - ay)) / area, zy = ((cz - az) * (bx - ax) - (bz - az) * (cx - ax)) / area;
    for (let y = top; y <= bottom; y++) {
      const py = y + 0.5;
      for (let x = left; x <= right; x++) {
        const px = x + 0.5;
        if ((bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0) continue;
        if ((cx - bx) * (py - by) - (cy - by) * (px - bx) > 0) continue;
        if ((ax - cx) * (py - cy) - (ay - cy) * (px - cx) > 0) continue;
        const z = az + zx * (px - ax) + zy * (py - ay), at = y * width + x;
        if (z > near[at]) {
          near[at] = z;
          shade[at] = bright;
        }
      }
    }
  }
}

/** Turn and move points of a body: seven numbers, place and quaternion, in parts of ten thousand. */
function moved(points, frame, at) {
  const [x, y, z, qx, qy, qz, qw] = frame.slice(at, at + 7).map((part) => part / 1e4);
  const out = new Float32Array(points.length);
  for (let k = 0; k < points.length; k += 3) {
    const [px, py, pz] = [points[k], points[k + 1], points[k + 2]];
    const [tx, ty, tz] = [2 * (qy * pz - qz * py), 2 * (qz * px - qx * pz), 2 * (qx * py - qy * px)];
    out[k] = x + px + qw * tx + qy * tz - qz * ty;
    out[k + 1] = y + py + qw * ty + qz * tx - qx * tz;
    out[k + 2] = z + pz + qw * tz + qx * ty - qy * tx;
  }
  return out;
}

/** Brightness of every triangle under a light beside the eye, 0 to 255 times that of its solid. */
function shading(points, faces, light, own) {
  const out = new Uint8Array(faces.length / 3);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
    const u = [0, 1, 2].map((k) => points[b + k] - points[a + k]), v = [0, 1, 2].map((k) => points[c + k] - points[a + k]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const cosine = (n[0] * light[0] + n[1] * light[1] + n[2] * light[2]) / (Math.hypot(...n) || 1);
    out[f / 3] = Math.round(255 * own * (0.45 + 0.55 * Math.max(0, cosine)));
  }
  return out;
}

/** Let a canvas turn a camera: drag, pinch or wheel with Ctrl, arrow keys; a double click goes home. */
function turnable(canvas, camera, redraw, pick = () => {}) {
  const touches = new Map();
  let spread = 0, travelled = 0;
  canvas.tabIndex = 0;
  const near = (factor) => {
    camera.distance = Math.min(Math.max(camera.distance * factor, 0.2 * camera.home.distance), 4 * camera.home.distance);
    redraw();
  };
  const turn = (dx, dy) => {
    camera.yaw -= dx;
    camera.pitch = Math.min(1.55, Math.max(-0.5, camera.pitch + dy));
    redraw();
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    [travelled, spread] = [0, 0];
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = touches.get(event.pointerId);
    if (!last) return;
    const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
    touches.set(event.pointerId, [event.clientX, event.clientY]);
    travelled += Math.abs(dx) + Math.abs(dy);
    if (touches.size === 1) turn(0.008 * dx, 0.008 * dy);
    else {
      const [a, b] = [...touches.values()];
      const now = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (spread) near(spread / now);
      spread = now;
    }
  });
  const up = (event) => {
    if (touches.delete(event.pointerId) && travelled < 6 && event.type === "pointerup") pick(event);
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("dblclick", () => (Object.assign(camera, camera.home), redraw()));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return; // a page scrolls
    event.preventDefault();
    near(Math.exp(0.002 * event.deltaY));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (step) (event.preventDefault(), turn(...step));
    if (event.key === "+") near(0.9);
    if (event.key === "-") near(1.1);
  });
}

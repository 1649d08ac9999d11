// Turns a layout in the page: every <script class="scene-data"> in a figure becomes a view that mouse, touch and keys
// move.  Parallel projection, as in the picture that stands there without it: one scale holds everywhere.
"use strict";
(() => {
  const FONT = "12px Helvetica, Arial, 'DejaVu Sans', sans-serif", HEIGHT = 12;
  const INK = "#222222", MUTED = "#555555", PAPER = "#ffffff";
  const LABELS = { target: "#a84600", "pivot 1": "#00795a", "pivot 2": "#a8477f", source: MUTED };
  const DEGREE = Math.PI / 180, TURN = 5 * DEGREE, STEP = 24, ZOOM = 1.2;
  const RING = 48;
  const ROOM = 1100, NAMED_ALWAYS = ["targets", "beams", "directions"]; // area of page that a label needs
  const calm = window.matchMedia("(prefers-reduced-motion: reduce)");

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const plus = (a, b, f = 1) => [a[0] + f * b[0], a[1] + f * b[1], a[2] + f * b[2]];
  const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };
  const clamp = (v, low, high) => Math.min(Math.max(v, low), high);

  function turned(v, axis, angle) { // about a unit axis through the origin (Rodrigues)
    const c = Math.cos(angle), s = Math.sin(angle), along = dot(axis, v) * (1 - c), side = cross(axis, v);
    return v.map((x, k) => x * c + side[k] * s + axis[k] * along);
  }

  const labelOf = (words) => /^fiducial (.*): x /.exec(words)?.[1] ?? null; // of a fiducial, from what is said of it

  function roundStep(about) {
    const power = 10 ** Math.floor(Math.log10(about));
    return power * Math.max(...[1, 2, 5].filter((f) => f * power <= about * (1 + 1e-9)));
  }

  function element(name, attributes = {}, ...children) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  }

  class Viewer {
    constructor(figure, scene, number) {
      this.scene = scene;
      this.shown = new Set(scene.layers.filter((layer) => layer.shown).map((layer) => layer.key));
      this.pointers = new Map();
      this.places = new Map(); // of labels, so that they stay where they are while the view turns
      this.hits = [];
      this.pointed = this.told = null; // labels of the fiducials that are ringed, and below the pointer
      this.build(figure, number);
      this.context = this.canvas.getContext("2d");
      this.first = scene.cameras[0];
      this.right = this.first.right;
      this.up = this.first.up;
      this.extent = "near";
      this.resize();
      this.listen();
      this.say();
    }

    // --- page -------------------------------------------------------------------------------------

    // Another scene of the same layout: seen from where the last one was.
    update(scene) {
      const had = this.scene.layers.map((layer) => layer.key);
      for (const { key, shown } of scene.layers) if (shown && !had.includes(key)) this.shown.add(key);
      this.scene = scene;
      this.places.clear();
      this.describe();
      this.draw();
    }

    // The fiducial of this label is ringed; null: none is.
    point(label) {
      this.pointed = label;
      this.draw();
    }

    build(figure, number) {
      const id = `viewer-${number}`;
      const button = (words, action, more = {}) => {
        const made = element("button", { type: "button", ...more }, words);
        made.addEventListener("click", action);
        return made;
      };
      this.canvas = element("canvas", {
        tabindex: "0", role: "application", "aria-roledescription": "3-D view", "aria-label": this.scene.title,
        "aria-describedby": `${id}-words ${id}-help`,
      });
      this.tip = element("div", { class: "viewer-tip", "aria-hidden": "true" });
      this.status = element("p", { class: "viewer-status", role: "status" });
      this.looks = this.scene.cameras.map((camera) =>
        button(camera.label, () => this.look(camera), { "aria-pressed": "false" }));
      this.extents = [["near", "Structure"], ["far", "Whole set-up"]].map(([key, words]) =>
        button(words, () => this.frame(key), { "aria-pressed": "false", "data-extent": key }));
      const group = (name, ...children) => element("div", { role: "group", "aria-label": name }, ...children);
      const bar = element("div", { class: "viewer-bar" },
        group("Direction of view", ...this.looks), group("Extent", ...this.extents),
        group("Zoom", button("+", () => this.zoom(ZOOM), { "aria-label": "Zoom in" }),
          button("−", () => this.zoom(1 / ZOOM), { "aria-label": "Zoom out" })));
      this.layers = element("fieldset", { class: "viewer-layers" });
      this.note = element("p", { class: "viewer-note" });
      this.words = element("p", { class: "viewer-words", id: `${id}-words` });
      this.describe();
      const help = "Drag, or arrow keys: turn. Shift with them, or two fingers: move. + and −, pinch, or the wheel once "
        + "the view has focus: zoom. 1 to " + Math.min(this.looks.length, 9) + ": directions of view. 0: as at first.";
      this.viewer = element("div", { class: "viewer" },
        bar, element("div", { class: "viewer-stage" }, this.canvas, this.tip), this.status, this.layers,
        element("p", { class: "viewer-help", id: `${id}-help` }, help), this.note, this.words);
      figure.insertBefore(this.viewer, figure.querySelector("svg"));
      figure.classList.add("live");
    }

    // What there is to show, and the scene in words.
    describe() {
      this.note.textContent = this.scene.note;
      this.words.textContent = this.scene.words;
      const listed = JSON.stringify(this.scene.layers.map(({ key, label }) => {
        const { kind, look } = this.scene.items.find((item) => item.layer === key) || {};
        return [key, label, kind, look];
      }));
      if (listed === this.listed) return; // what moves looks as it did
      this.listed = listed;
      this.boxes = new Map();
      this.layers.replaceChildren(element("legend", {}, "Shown"));
      for (const layer of this.scene.layers) {
        const box = element("input", { type: "checkbox" });
        this.boxes.set(layer.key, box);
        box.checked = this.shown.has(layer.key);
        box.addEventListener("change", () => this.show(layer.key, box.checked));
        this.layers.append(element("label", {}, box, this.swatch(layer.key), layer.label));
      }
    }

    swatch(key) {
      const item = this.scene.items.find((entry) => entry.layer === key);
      const canvas = element("canvas", { class: "viewer-swatch", "aria-hidden": "true" });
      const ratio = 2, context = canvas.getContext("2d");
      [canvas.width, canvas.height] = [22 * ratio, 14 * ratio];
      context.scale(ratio, ratio);
      if (!item) {
        context.font = "bold 11px Helvetica, Arial, sans-serif";
        context.fillText("F1", 4, 11);
        return canvas;
      }
      if (item.kind === "mark") {
        this.mark(context, item.look, 11, 7);
        return canvas;
      }
      const look = this.scene.looks[item.look];
      this.pen(context, look);
      context.beginPath();
      if (item.kind === "ellipsoid" || item.kind === "face") context.ellipse(11, 7, 9, 5, 0, 0, 2 * Math.PI);
      else { context.moveTo(2, 7); context.lineTo(item.kind === "arrow" ? 16 : 20, 7); }
      this.paint(context, look);
      if (item.kind === "arrow") this.head(context, [2, 7], [20, 7], look);
      return canvas;
    }

    listen() {
      const canvas = this.canvas;
      new ResizeObserver(() => this.resize()).observe(canvas);
      canvas.addEventListener("keydown", (event) => this.key(event));
      canvas.addEventListener("contextmenu", (event) => event.preventDefault());
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
        this.tell(null);
      });
      canvas.addEventListener("pointermove", (event) => this.move(event));
      for (const name of ["pointerup", "pointercancel"]) {
        canvas.addEventListener(name, (event) => { this.pointers.delete(event.pointerId); this.say(); });
      }
      canvas.addEventListener("pointerleave", () => this.tell(null));
      canvas.addEventListener("wheel", (event) => {
        if (document.activeElement !== canvas && !event.ctrlKey) return; // the page scrolls on
        event.preventDefault();
        const lines = event.deltaMode === 1 ? 16 : 1;
        this.zoom(Math.exp(-clamp(event.deltaY * lines, -120, 120) / 400), [event.offsetX, event.offsetY]);
      }, { passive: false });
    }

    move(event) {
      const was = this.pointers.get(event.pointerId), now = [event.offsetX, event.offsetY];
      if (!was) { this.tell(now); return; }
      const step = [now[0] - was[0], now[1] - was[1]];
      const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      this.pointers.set(event.pointerId, now);
      if (others.length) {
        const spread = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]);
        this.pan(step[0] / 2, step[1] / 2);
        this.zoom(spread(now) / Math.max(spread(was), 1), [(now[0] + others[0][0]) / 2, (now[1] + others[0][1]) / 2]);
      } else if (event.shiftKey || event.buttons > 1) {
        this.pan(...step);
      } else {
        this.turn(-0.5 * step[0] * DEGREE, -0.5 * step[1] * DEGREE);
      }
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      const way = arrows[event.key], camera = this.scene.cameras[Number(event.key) - 1];
      if (way && event.shiftKey) this.pan(STEP * way[0], STEP * way[1]);
      else if (way) this.turn(-TURN * way[0], -TURN * way[1]);
      else if (event.key === "+" || event.key === "=") this.zoom(ZOOM);
      else if (event.key === "-" || event.key === "−") this.zoom(1 / ZOOM);
      else if (event.key === "0" || event.key === "Home") { this.frame("near"); this.look(this.first); }
      else if (/^[1-9]$/.test(event.key) && camera) this.look(camera);
      else return;
      event.preventDefault();
      this.say();
    }

    // --- camera -----------------------------------------------------------------------------------

    resize() {
      const { clientWidth: width, clientHeight: height } = this.canvas, ratio = window.devicePixelRatio || 1;
      if (!width || !height) return;
      const scaled = this.width ? Math.min(width / this.width, height / this.height) : 1;
      [this.width, this.height] = [width, height];
      [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
      this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
      if (!this.scale) { this.fit(); return; } // also where the figure was hidden at first
      this.scale *= scaled;
      this.draw();
    }

    fit() {
      if (!this.width) return;
      const flat = this.scene[this.extent].map((p) => [dot(p, this.right), dot(p, this.up)]);
      const ends = [0, 1].map((k) => [Math.min(...flat.map((p) => p[k])), Math.max(...flat.map((p) => p[k]))]);
      const room = [this.width - 90, this.height - 96];
      this.scale = Math.min(...ends.map(([low, high], k) => room[k] / Math.max(high - low, 1e-3)));
      const middle = ends.map(([low, high]) => (low + high) / 2), eye = cross(this.right, this.up);
      const deep = this.scene[this.extent].reduce((sum, p) => sum + dot(p, eye), 0) / flat.length;
      const raised = middle[1] - 16 / this.scale; // the foot of the stage has axes and bar
      this.centre = plus(plus(this.right.map((v) => v * middle[0]), this.up, raised), eye, deep);
      this.draw();
    }

    show(key, wanted) {
      if (!this.boxes.has(key)) return;
      this.boxes.get(key).checked = wanted;
      this.shown[wanted ? "add" : "delete"](key);
      this.draw();
    }

    frame(extent) { // close up, the sides of the beams would cross the structure: arrows say where they come from
      this.extent = extent;
      for (const layer of ["beams", "directions"]) this.show(layer, (layer === "beams") === (extent === "far"));
      this.fit();
      this.say();
    }

    turn(yaw, pitch) {
      const z = [0, 0, 1], right = unit(turned(this.right, z, yaw)), up = turned(this.up, z, yaw);
      const tilted = turned(up, right, pitch);
      const over = tilted[2] < 0 && up[2] >= 0; // not over the top: z stays up
      this.aim(right, over ? up : tilted);
    }

    aim(right, up) {
      this.right = unit(right);
      this.up = unit(plus(up, this.right, -dot(up, this.right)));
      this.draw();
    }

    look(camera) {
      const from = [this.right, this.up], begun = performance.now();
      window.cancelAnimationFrame(this.running);
      const opposite = dot(from[0], camera.right) < -0.9 || dot(from[1], camera.up) < -0.9;
      const span = calm.matches || opposite ? 0 : 350;
      const step = (now) => {
        const t = span ? clamp((now - begun) / span, 0, 1) : 1, s = t * t * (3 - 2 * t);
        const mix = (a, b) => a.map((v, k) => (1 - s) * v + s * b[k]);
        const between = [mix(from[0], camera.right), mix(from[1], camera.up)];
        [this.right, this.up] = t < 1 ? between : [camera.right, camera.up];
        this.right = unit(this.right);
        this.up = unit(plus(this.up, this.right, -dot(this.up, this.right)));
        this.fit();
        if (t < 1) this.running = window.requestAnimationFrame(step);
        else this.say();
      };
      if (span) this.running = window.requestAnimationFrame(step);
      else step(begun);
    }

    pan(x, y) {
      this.centre = plus(plus(this.centre, this.right, -x / this.scale), this.up, y / this.scale);
      this.draw();
    }

    zoom(factor, at = [this.width / 2, this.height / 2]) {
      const next = clamp(this.scale * factor, 0.02, 400), off = [at[0] - this.width / 2, at[1] - this.height / 2];
      const shift = 1 / this.scale - 1 / next;
      this.centre = plus(plus(this.centre, this.right, off[0] * shift), this.up, -off[1] * shift);
      this.scale = next;
      this.draw();
      this.say();
    }

    say() {
      window.clearTimeout(this.saying);
      this.saying = window.setTimeout(() => {
        const eye = cross(this.right, this.up), same = (a, b) => Math.abs(a - b) < 1e-4;
        const now = this.scene.cameras.findIndex((camera) =>
          camera.right.every((v, k) => same(v, this.right[k])) && camera.up.every((v, k) => same(v, this.up[k])));
        this.looks.forEach((entry, k) => entry.setAttribute("aria-pressed", String(k === now)));
        for (const entry of this.extents) {
          entry.setAttribute("aria-pressed", String(entry.dataset.extent === this.extent));
        }
        const azimuth = Math.round(Math.atan2(eye[1], eye[0]) / DEGREE);
        const elevation = Math.round(Math.asin(clamp(eye[2], -1, 1)) / DEGREE);
        const across = (this.width / this.scale).toPrecision(3);
        const words = `Seen from azimuth ${azimuth}°, elevation ${elevation}° of con; ${Number(across)} mm across.`;
        this.status.textContent = words.replace(/-(?=\d)/g, "−");
      }, 250);
    }

    // --- drawing ----------------------------------------------------------------------------------

    page(point) {
      const from = plus(point, this.centre, -1);
      return [this.width / 2 + this.scale * dot(from, this.right), this.height / 2 - this.scale * dot(from, this.up)];
    }

    draw() {
      if (this.waiting) return;
      this.waiting = window.requestAnimationFrame(() => { this.waiting = 0; this.render(); });
    }

    render() {
      const context = this.context, eye = cross(this.right, this.up);
      const order = { face: 0, line: 1, ellipsoid: 2, arrow: 2, mark: 2 };
      context.fillStyle = PAPER;
      context.fillRect(0, 0, this.width, this.height);
      this.under?.(context); // by a page on which things are moved
      this.hits = [];
      const items = this.scene.items.filter((item) => this.shown.has(item.layer)).map((item) => {
        const solid = item.kind === "ellipsoid" ? item.points.slice(0, 1) : item.points;
        const deep = solid.reduce((sum, p) => sum + dot(p, eye), 0) / solid.length;
        return { item, deep, rank: order[item.kind], below: item.layer === "floor" };
      });
      items.sort((a, b) => b.below - a.below || a.rank - b.rank || a.deep - b.deep);
      const dots = items.filter(({ item }) => item.layer === "fiducials").map(({ item }) => this.page(item.points[0]));
      const area = [0, 1].map((k) => Math.max(...dots.map((p) => p[k])) - Math.min(...dots.map((p) => p[k])) + 40);
      this.crowded = dots.length > 1 && area[0] * area[1] < ROOM * dots.length;
      this.size = this.crowded ? 0.65 : 1;
      const labels = [];
      for (const { item } of items) {
        const page = item.kind === "ellipsoid" ? [this.page(item.points[0])] : item.points.map((p) => this.page(p));
        this.item(context, item, page, eye);
        if (this.pointed !== null && labelOf(item.title) === this.pointed) this.mark(context, "ring", ...page[0]);
        const along = item.kind === "arrow" && item.layer !== "directions" ? page[page.length - 1] : page[0];
        const middle = [0, 1].map((k) => page.reduce((sum, p) => sum + p[k], 0) / page.length);
        const at = item.kind === "line" ? middle : along;
        if (item.title) this.hits.push({ at, words: item.title, reach: item.kind === "mark" ? 10 : 7 });
        if (item.label || item.kind === "mark") labels.push({ item, at, page });
      }
      if (this.shown.has("labels")) this.label(context, labels);
      this.axes(context);
      this.over?.(context);
    }

    item(context, item, page, eye) {
      if (item.kind === "mark") { this.mark(context, item.look, ...page[0], this.size); return; }
      const look = this.scene.looks[item.look];
      this.pen(context, look);
      context.beginPath();
      if (item.kind === "ellipsoid") { this.ellipsoid(context, item.points.slice(1), page[0], look, eye); return; }
      page.forEach((p, k) => (k ? context.lineTo(...p) : context.moveTo(...p)));
      if (item.kind === "face") context.closePath();
      this.paint(context, item.kind === "face" ? look : { ...look, fill: undefined });
      if (item.kind === "arrow") this.head(context, page[0], page[1], look);
    }

    pen(context, look) {
      context.strokeStyle = look.stroke;
      context.lineWidth = 1.15 * look.width;
      context.setLineDash(look.dash || []);
      context.lineJoin = "round";
    }

    paint(context, look) {
      if (look.fill) {
        context.globalAlpha = look.opacity;
        context.fillStyle = look.fill;
        context.fill();
        context.globalAlpha = 1;
      }
      context.stroke();
      context.setLineDash([]);
    }

    head(context, from, to, look) {
      const along = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(...along);
      if (length < 1) return;
      const size = Math.min(4 + 2.6 * look.width, 0.6 * length), [x, y] = along.map((v) => v / length);
      context.fillStyle = look.stroke;
      context.beginPath();
      context.moveTo(...to);
      context.lineTo(to[0] - size * (x + 0.42 * y), to[1] - size * (y - 0.42 * x));
      context.lineTo(to[0] - size * (x - 0.42 * y), to[1] - size * (y + 0.42 * x));
      context.fill();
    }

    ellipsoid(context, axes, centre, look, eye) {
      const flat = axes.map((a) => [this.scale * dot(a, this.right), -this.scale * dot(a, this.up)]);
      const sum = (i, j) => flat.reduce((total, a) => total + a[i] * a[j], 0);
      const [a, b, c] = [sum(0, 0), sum(0, 1), sum(1, 1)], mid = (a + c) / 2, swing = Math.hypot((a - c) / 2, b);
      const [major, minor] = [mid + swing, mid - swing].map((v) => Math.sqrt(Math.max(v, 0)));
      context.ellipse(...centre, major, minor, Math.atan2(2 * b, a - c) / 2, 0, 2 * Math.PI);
      this.paint(context, look);
      context.lineWidth = 0.7;
      for (const [i, j] of [[0, 1], [1, 2], [2, 0]]) {
        for (const near of [false, true]) {
          context.globalAlpha = near ? 1 : 0.3;
          context.beginPath();
          for (let k = 0; k < RING; k += 1) {
            const [t, u] = [k, k + 1].map((n) => (2 * Math.PI * n) / RING);
            const ends = [t, u].map((w) => [0, 1, 2].map((m) => Math.cos(w) * axes[i][m] + Math.sin(w) * axes[j][m]));
            if ((dot(ends[0], eye) + dot(ends[1], eye) >= 0) !== near) continue;
            ends.forEach((p, end) => context[end ? "lineTo" : "moveTo"](
              centre[0] + this.scale * dot(p, this.right), centre[1] - this.scale * dot(p, this.up)));
          }
          context.stroke();
        }
      }
      context.globalAlpha = 1;
    }

    mark(context, look, x, y, size = 1) {
      context.save();
      context.translate((1 - size) * x, (1 - size) * y);
      context.scale(size, size);
      this.shape(context, look, x, y);
      context.restore();
    }

    shape(context, look, x, y) {
      const disc = (radius, fill, stroke, width) => {
        context.beginPath();
        context.arc(x, y, radius, 0, 2 * Math.PI);
        context.fillStyle = fill;
        context.fill();
        if (!stroke) return;
        context.strokeStyle = stroke;
        context.lineWidth = width;
        context.setLineDash([]);
        context.stroke();
      };
      if (look === "fiducial") {
        const shine = context.createRadialGradient(x - 1.6, y - 1.8, 0.4, x, y, 5);
        shine.addColorStop(0, "#8cc6ec");
        shine.addColorStop(0.55, "#0072b2");
        shine.addColorStop(1, "#004f7c");
        disc(4.6, shine);
      } else if (look === "ring") disc(9, "transparent", INK, 2);
      else if (look === "new") disc(4, PAPER, "#0072b2", 1.8);
      else if (look === "old") disc(3.4, PAPER, "#8a8a8a", 1.3);
      else if (look === "image") disc(1.3, "#0072b2");
      else if (look === "source") disc(4, "#4b5660");
      else if (look === "target") {
        context.strokeStyle = "#d55e00";
        context.lineWidth = 2.2;
        context.setLineDash([]);
        context.beginPath();
        for (const [sx, sy] of [[1, 1], [1, -1]]) {
          context.moveTo(x - 5.5 * sx, y - 5.5 * sy);
          context.lineTo(x + 5.5 * sx, y + 5.5 * sy);
        }
        context.stroke();
      } else {
        const tip = look === "pivot 1" ? -1 : 1;
        context.fillStyle = LABELS[look];
        context.beginPath();
        context.moveTo(x, y + 7 * tip);
        context.lineTo(x - 6.2, y - 5 * tip);
        context.lineTo(x + 6.2, y - 5 * tip);
        context.fill();
      }
    }

    label(context, labels) {
      context.font = FONT;
      context.textBaseline = "alphabetic";
      const inside = ([x, y]) => x > 0 && y > 0 && x < this.width && y < this.height;
      const seen = labels.filter(({ at }) => inside(at));
      const named = seen.filter(({ item }) => item.kind === "mark");
      const taken = named.map(({ at: [x, y] }) => [x - 5, y - 5, x + 5, y + 5]);
      for (const { item, page: [from, to] } of seen) { // labels keep off arrows, too
        for (let k = 0; item.kind === "arrow" && k <= 8; k += 1) {
          const [x, y] = [0, 1].map((axis) => from[axis] + (k / 8) * (to[axis] - from[axis]));
          taken.push([x - 3, y - 3, x + 3, y + 3]);
        }
      }
      const marks = taken.length;
      for (const { item, at: [x, y] } of seen) {
        if (!item.label || (this.crowded && !NAMED_ALWAYS.includes(item.layer))) continue;
        const lines = item.label.split("\n");
        const wide = Math.max(...lines.map((line) => context.measureText(line).width));
        let best = null;
        [[8, 4], [-8 - wide, 4], [-wide / 2, -9], [-wide / 2, 18], [7, -6], [-7 - wide, -6], [7, 15], [-7 - wide, 15],
          [15, 4], [-15 - wide, 4], [-wide / 2, -18], [-wide / 2, 27]].forEach(([dx, dy], k) => {
          const up = (lines.length - 1) * HEIGHT * (dy < 0 ? 1 : dy === 4 ? 0.5 : 0);
          const top = y + dy - HEIGHT + 2 - up;
          const box = [x + dx, top, x + dx + wide, top + lines.length * HEIGHT];
          let harm = k === this.places.get(item) ? 0 : 1.5 + 0.6 * k;
          for (const [n, other] of taken.entries()) {
            const across = Math.min(box[2], other[2]) - Math.max(box[0], other[0]);
            const down = Math.min(box[3], other[3]) - Math.max(box[1], other[1]);
            if (across > 0 && down > 0) harm += across * down * (n < marks ? 1 : 2);
          }
          const out = Math.max(-box[0], 0) + Math.max(-box[1], 0) + Math.max(box[2] - this.width, 0);
          harm += 20 * (out + Math.max(box[3] - this.height, 0));
          if (!best || harm < best.harm) best = { harm, box, k };
        });
        this.places.set(item, best.k);
        taken.push(best.box);
        context.lineWidth = 3;
        context.strokeStyle = PAPER;
        context.lineJoin = "round";
        context.fillStyle = LABELS[item.look] || (item.kind === "mark" ? INK : MUTED);
        lines.forEach((line, k) => {
          const foot = best.box[1] + (k + 1) * HEIGHT - 2;
          context.strokeText(line, best.box[0], foot);
          context.fillText(line, best.box[0], foot);
        });
      }
    }

    axes(context) {
      const x = 52, y = this.height - 34, arm = 34;
      const length = roundStep(Math.min(0.3 * this.width, 160) / this.scale);
      const end = this.width - 16, begin = end - length * this.scale, foot = this.height - 16;
      context.font = FONT;
      context.fillStyle = "rgba(255, 255, 255, 0.85)"; // lines of the scene may run below
      context.fillRect(begin - 8, foot - 24, end - begin + 16, 34);
      context.fillRect(6, 6, 88, 17);
      context.strokeStyle = context.fillStyle = INK;
      context.lineWidth = 1.4;
      context.textAlign = "center";
      ["x", "y", "z"].forEach((name, k) => {
        const [dx, dy] = [arm * this.right[k], -arm * this.up[k]];
        context.beginPath();
        context.moveTo(x, y);
        context.lineTo(x + dx, y + dy);
        context.stroke();
        if (Math.hypot(dx, dy) > 6) context.fillText(name, x + 1.28 * dx, y + 1.28 * dy + 4);
      });
      context.beginPath();
      for (const [x0, y0, x1, y1] of [
        [begin, foot, end, foot], [begin, foot - 4, begin, foot + 4], [end, foot - 4, end, foot + 4],
      ]) {
        context.moveTo(x0, y0);
        context.lineTo(x1, y1);
      }
      context.stroke();
      context.fillText(`${Number(length.toPrecision(3))} mm`, (begin + end) / 2, foot - 8);
      context.textAlign = "start";
      context.fillStyle = MUTED;
      context.fillText("frame con, mm", 10, 18);
    }

    tell(at) {
      const away = (hit) => Math.hypot(hit.at[0] - at[0], hit.at[1] - at[1]);
      const near = (at ? this.hits : []).filter((hit) => away(hit) < hit.reach).sort((a, b) => away(a) - away(b));
      const found = near[0]; // a target, its ellipsoid and its bias stand in one place
      this.tip.textContent = near.slice(0, 4).map((hit) => hit.words).join("\n");
      this.tip.style.display = found ? "block" : "none";
      const label = found ? labelOf(found.words) : null;
      if (label !== this.told) this.canvas.dispatchEvent(new CustomEvent("point", { detail: label, bubbles: true }));
      this.told = label;
      if (!found) return;
      const wide = this.tip.offsetWidth, tall = this.tip.offsetHeight;
      this.tip.style.left = `${clamp(found.at[0] + 12, 0, Math.max(this.width - wide, 0))}px`;
      this.tip.style.top = `${found.at[1] + 14 + tall < this.height ? found.at[1] + 14 : found.at[1] - 14 - tall}px`;
    }
  }

  globalThis.LayoutViewer = Viewer; // for a page that makes its scenes itself
  document.querySelectorAll("script.scene-data").forEach((data, k) => {
    const figure = data.closest("figure");
    if (figure && window.ResizeObserver) new Viewer(figure, JSON.parse(data.textContent), k + 1);
  });
})();

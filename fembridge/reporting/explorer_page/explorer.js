/* The page of `fembridge explore`: plays a touch or a simulation.

   Reads the arrays, draws the scene (three.js, or a picture from above; of a simulation the section
   of the finger) and the plots, and moves all of them in time. */
(async function () {
  "use strict";

  const DATA = /*DATA*/ null;
  const root = document.getElementById("explorer");
  const LIT_MS = 30; /* a unit is lit for so long after a spike */
  const SPEEDS = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01];
  const PLAYED_S = 7; /* about as long as the whole takes at first */
  const LEVELS = 48; /* of the picture from above */
  const DARK = [24, 20, 28]; /* the largest pressure or stress */
  const MARKS = { SA: "circle", RA: "triangle", PC: "square" };

  /* ---- Arrays */

  const TYPES = {
    float32: Float32Array,
    float64: Float64Array,
    uint8: Uint8Array,
    uint16: Uint16Array,
    uint32: Uint32Array,
  };

  async function unpacked({ type, shape, zlib }) {
    const packed = Uint8Array.from(atob(zlib), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const values = new TYPES[type](await new Response(stream).arrayBuffer());
    return Object.assign(values, { shape });
  }

  const arrays = {};
  for (const [name, packed] of Object.entries(DATA.arrays)) arrays[name] = await unpacked(packed);

  /* ---- Text, elements, colours */

  function short(value, digits) {
    return String(Number(value.toPrecision(digits || 3)));
  }

  function make(tag, name, parent, text) {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (text) made.textContent = text;
    if (parent) parent.append(made);
    return made;
  }

  function colours() {
    const style = getComputedStyle(document.documentElement), named = {};
    for (const name of ["ink", "muted", "faint", "shade", "page", "scene", "skin", "force", "SA", "RA", "PC"])
      named[name] = style.getPropertyValue("--" + name).trim();
    return named;
  }

  function context(canvas, width, height) {
    const ratio = window.devicePixelRatio || 1;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    return pen;
  }

  function write(pen, text, x, y, colour, size, align, weight) {
    pen.fillStyle = colour;
    pen.font = (weight || "normal") + " " + size + "px " + getComputedStyle(document.body).fontFamily;
    pen.textAlign = align || "left";
    pen.fillText(text, x, y);
    return pen.measureText(text).width;
  }

  /* A mark of a class: a disc, a triangle or a square. */
  function trace(pen, mark, x, y, radius) {
    pen.beginPath();
    if (mark === "circle") {
      pen.arc(x, y, radius, 0, 2 * Math.PI);
    } else if (mark === "triangle") {
      pen.moveTo(x, y - 1.2 * radius);
      pen.lineTo(x + 1.1 * radius, y + 0.8 * radius);
      pen.lineTo(x - 1.1 * radius, y + 0.8 * radius);
      pen.closePath();
    } else {
      pen.rect(x - 0.9 * radius, y - 0.9 * radius, 1.8 * radius, 1.8 * radius);
    }
  }

  function niceTop(value) {
    if (!(value > 0)) return 1;
    const power = Math.pow(10, Math.floor(Math.log10(value)));
    return [1, 2, 5, 10].map((k) => k * power).find((top) => top >= value * (1 - 1e-9));
  }

  /* Number of sorted values that are at most `value`. */
  function countTo(values, value) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] <= value) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  function classOf(name) {
    return name in MARKS ? name : "ink";
  }

  /* ---- What is shown: a touch, or a stimulus of a simulation */

  /* Spikes of `rows` (units or cells), sorted; `lit` fills how bright each is at a time. */
  class Spikes {
    constructor(times, rows, count) {
      Object.assign(this, { times, rows, count });
      this.of = Array.from({ length: count }, () => []);
      for (let n = 0; n < times.length; n++) this.of[rows[n]].push(times[n]);
    }

    lit(time, brightness) {
      brightness.fill(0);
      for (let n = countTo(this.times, time) - 1; n >= 0 && this.times[n] > time - LIT_MS; n--) {
        const row = this.rows[n];
        brightness[row] = Math.max(brightness[row], 1 - (time - this.times[n]) / LIT_MS);
      }
      return brightness;
    }
  }

  function touchModel(trial) {
    const keep = [];
    arrays.spike_trial.forEach((of, n) => of === trial && keep.push(n));
    const spikes = new Spikes(
      Float64Array.from(keep, (n) => arrays.spike_ms[n]),
      Uint32Array.from(keep, (n) => arrays.spike_unit[n]),
      DATA.units.length,
    );
    const nameOf = (unit) => DATA.classes[arrays.unit_class[unit]];
    const step = arrays.time_ms.length > 1 ? arrays.time_ms[1] - arrays.time_ms[0] : 1;
    const bands = [
      { title: "Force", unit: DATA.force_unit, colour: "force", values: arrays.force_n, step, start: 0, dashed: true },
      { title: "Depth", unit: "µm", colour: "ink", values: arrays.depth_um, step, start: 0 },
    ];
    DATA.classes.forEach((name, index) => {
      const units = [];
      arrays.unit_class.forEach((of, unit) => of === index && units.push(unit));
      const fire = units.filter((unit) => spikes.of[unit].length);
      fire.sort((a, b) => arrays.unit_mm[3 * b + 2] - arrays.unit_mm[3 * a + 2]);
      const note = fire.length + " of " + units.length + " units fire";
      bands.push({ title: name, note, colour: classOf(name), rows: fire.map((unit) => spikes.of[unit]), units: fire });
    });
    const hardest = arrays.force_n.reduce((best, force, n) => (force > arrays.force_n[best] ? n : best), 0);
    const tell = (unit) => {
      const name = DATA.units[unit] + " (" + nameOf(unit) + ")";
      return name + ": " + short(arrays.rate_ips[unit]) + " impulses/s, " + short(arrays.unit_depth_mm[unit], 2) + " mm deep";
    };
    return { spikes, bands, start_ms: 0, end_ms: DATA.duration_ms, first_ms: arrays.time_ms[hardest], window_ms: DATA.window_ms, tell };
  }

  function stimulusModel(row) {
    const entry = DATA.stimuli[row], { afferents } = DATA, first = [];
    let count = 0;
    for (const afferent of afferents) {
      first.push(count);
      count += afferent.cells;
    }
    const times = arrays["spike_ms_" + row], of = arrays["spike_afferent_" + row], cell = arrays["spike_cell_" + row];
    const spikes = new Spikes(times, Uint32Array.from(times, (_, n) => first[of[n]] + cell[n]), count);
    const depth = arrays["depth_um_" + row], stress = arrays["stress_pa_" + row], samples = stress.shape[1];
    const end_ms = Math.max((depth.length - 1) * entry.depth_dt_ms, entry.start_ms + (samples - 1) * entry.stress_dt_ms);
    const bands = [{ title: "Probe", unit: "µm", colour: "ink", values: depth, step: entry.depth_dt_ms, start: 0, signed: true }];
    afferents.forEach((afferent, k) => {
      const values = stress.subarray(k * samples, (k + 1) * samples).map((pressure) => pressure / 1000);
      const units = Array.from({ length: afferent.cells }, (_, n) => first[k] + n);
      const note = "stress in kPa";
      const right = entry.rates_ips[k].toFixed(1) + " impulses/s";
      bands.push({
        title: afferent.name, note, right, colour: classOf(afferent.class), values, step: entry.stress_dt_ms,
        start: entry.start_ms, filled: true, rows: units.map((unit) => spikes.of[unit]), units,
      });
    });
    const tell = (unit) => {
      const k = first.filter((start) => start <= unit).length - 1, cells = afferents[k].cells;
      const name = cells > 1 ? afferents[k].name + ", cell " + (unit - first[k] + 1) + " of " + cells : afferents[k].name;
      return name + ": " + spikes.of[unit].length + " spikes";
    };
    const deepest = depth.reduce((best, value, n) => (value > depth[best] ? n : best), 0);
    const aside = arrays["aside_um_" + row];
    return { spikes, bands, first, depth, aside, stress, samples, entry, start_ms: Math.min(0, entry.start_ms), end_ms, first_ms: deepest * entry.depth_dt_ms, window_ms: entry.window_ms, tell };
  }

  function valueAt(values, start, step, time) {
    const at = Math.min(Math.max((time - start) / step, 0), values.length - 1), low = Math.floor(at);
    const high = Math.min(low + 1, values.length - 1);
    return values[low] + (at - low) * (values[high] - values[low]);
  }

  /* ---- Plots over time */

  const LEFT = 58, RIGHT = 12, HEAD = 21, FOOT = 34, GAP = 13, AXIS = 12;

  class Plots {
    constructor(canvas) {
      this.canvas = canvas;
      this.still = document.createElement("canvas");
    }

    show(model) {
      this.model = model;
      this.drawn = "";
    }

    /* Heights: curves first, then what is left for the rows of all rasters. */
    arrange(height) {
      const { bands } = this.model, curve = 46;
      let fixed = FOOT, rows = 0;
      for (const band of bands) {
        fixed += HEAD + GAP + (band.values ? curve : 0) + (band.rows ? 8 : 0);
        rows += band.rows ? Math.max(band.rows.length, 1) : 0;
      }
      this.row = Math.max(isTouch ? 0.4 : 3.5, Math.min(6, (height - fixed) / Math.max(rows, 1)));
      let y = 0;
      for (const band of bands) {
        band.top = y + HEAD;
        band.base = band.top + (band.values ? curve : 0);
        band.first = band.base + (band.rows ? 6 : 0);
        band.end = band.rows ? band.first + Math.max(band.rows.length, 1) * this.row : band.base;
        y = band.end + GAP;
      }
      return y - GAP + FOOT;
    }

    draw(time) {
      const width = this.canvas.clientWidth, paint = colours();
      const key = [width, window.devicePixelRatio, paint.page].join();
      if (this.drawn !== key) {
        this.drawn = key;
        this.height = this.arrange(560);
        this.canvas.style.height = this.height + "px";
        this.drawStill(context(this.still, width, this.height), width, paint);
      }
      const pen = context(this.canvas, width, this.height);
      pen.drawImage(this.still, 0, 0, width, this.height);
      const x = Math.round(this.xOf(time)) + 0.5;
      pen.strokeStyle = paint.ink;
      pen.lineWidth = 1;
      pen.beginPath();
      for (const band of this.model.bands) {
        pen.moveTo(x, band.top);
        pen.lineTo(x, band.end);
      }
      pen.stroke();
    }

    xOf(time) {
      const { start_ms, end_ms } = this.model;
      return LEFT + ((time - start_ms) / (end_ms - start_ms)) * (this.canvas.clientWidth - LEFT - RIGHT);
    }

    timeOf(x) {
      const { start_ms, end_ms } = this.model, share = (x - LEFT) / (this.canvas.clientWidth - LEFT - RIGHT);
      return start_ms + Math.min(Math.max(share, 0), 1) * (end_ms - start_ms);
    }

    unitAt(y) {
      for (const band of this.model.bands) {
        const row = band.rows ? Math.floor((y - band.first) / this.row) : -1;
        if (row >= 0 && row < band.rows.length) return band.units[row];
      }
      return null;
    }

    drawStill(pen, width, paint) {
      const { bands, start_ms, end_ms, window_ms } = this.model, right = width - RIGHT;
      const line = (x0, y0, x1, y1, colour) => {
        pen.strokeStyle = colour;
        pen.lineWidth = 1;
        pen.beginPath();
        pen.moveTo(x0, y0);
        pen.lineTo(x1, y1);
        pen.stroke();
      };
      for (const band of bands) {
        const colour = paint[band.colour];
        const used = write(pen, band.title, LEFT, band.top - 7, colour, 14, "left", "bold");
        write(pen, band.note || "in " + band.unit, LEFT + used + 8, band.top - 7, paint.muted, 13);
        if (band.right) write(pen, band.right, right, band.top - 7, colour, 13, "right", "bold");
        pen.fillStyle = paint.shade;
        const inside = [this.xOf(window_ms[0]), this.xOf(Math.min(window_ms[1], end_ms))];
        if (inside[0] > LEFT) pen.fillRect(LEFT, band.top, inside[0] - LEFT, band.end - band.top);
        if (inside[1] < right) pen.fillRect(inside[1], band.top, right - inside[1], band.end - band.top);
        if (band.values) this.drawCurve(pen, band, paint, right, line);
        pen.fillStyle = colour;
        (band.rows || []).forEach((times, row) => {
          const y = band.first + row * this.row;
          for (const time of times) pen.fillRect(this.xOf(time) - 0.9, y, 1.8, Math.max(this.row - 1, 1));
        });
        if (band.rows && !band.rows.length) write(pen, "silent", LEFT - 6, band.first + 6, paint.muted, AXIS, "right");
      }
      const bottom = bands[bands.length - 1].end + 3, span = end_ms - start_ms;
      line(LEFT, bottom + 0.5, right, bottom + 0.5, paint.muted);
      const steps = [1, 2, 5].flatMap((k) => [10, 100, 1000, 10000].map((power) => k * power)).sort((a, b) => a - b);
      const step = steps.find((size) => (span / size) * 52 < width - LEFT - RIGHT) || 50000;
      for (let time = Math.ceil(start_ms / step) * step; time <= end_ms + 1e-6; time += step) {
        const x = this.xOf(time);
        line(x, bottom, x, bottom + 4, paint.muted);
        write(pen, String(time).replace("-", "−"), x, bottom + 16, paint.muted, AXIS, "center");
      }
      write(pen, "time in ms", right, bottom + 30, paint.muted, AXIS, "right");
      if (inside(window_ms, start_ms, end_ms))
        write(pen, "rates: outside of the shade", LEFT, bottom + 30, paint.muted, AXIS);
    }

    drawCurve(pen, band, paint, right, line) {
      const { values, step, start } = band, colour = paint[band.colour];
      const most = values.reduce((a, b) => Math.max(a, b), 0), least = values.reduce((a, b) => Math.min(a, b), 0);
      const top = niceTop(most), low = band.signed && least < 0 ? -niceTop(-least) : 0;
      const yOf = (value) => band.base - ((Math.max(value, low) - low) / (top - low)) * (band.base - band.top);
      for (const value of low < 0 ? [top, 0] : [top, 0]) {
        const y = Math.round(yOf(value)) + 0.5;
        line(LEFT, y, right, y, paint.faint);
        write(pen, short(value), LEFT - 6, y + 4, paint.muted, AXIS, "right");
      }
      const path = () => {
        pen.beginPath();
        const every = Math.max(1, Math.floor(values.length / (4 * (right - LEFT))));
        for (let n = 0; n < values.length; n += every) pen.lineTo(this.xOf(start + n * step), yOf(values[n]));
      };
      if (band.filled) {
        path();
        pen.lineTo(this.xOf(start + (values.length - 1) * step), band.base);
        pen.lineTo(this.xOf(start), band.base);
        pen.globalAlpha = 0.16;
        pen.fillStyle = colour;
        pen.fill();
        pen.globalAlpha = 1;
      }
      path();
      pen.strokeStyle = colour;
      pen.lineWidth = 1.6;
      pen.setLineDash(band.dashed ? [6, 2.5] : []);
      pen.stroke();
      pen.setLineDash([]);
    }
  }

  function inside(window_ms, start_ms, end_ms) {
    return window_ms[0] > start_ms + 1e-6 || window_ms[1] < end_ms - 1e-6;
  }

  /* ---- Scenes of a touch */

  /* The two frames around a time, and the share of the second. */
  function framesAt(time) {
    const frames = arrays.frame_ms, after = Math.min(countTo(frames, time), frames.length - 1);
    const before = Math.max(Math.min(after, frames.length) - 1, 0), width = frames[after] - frames[before];
    return [before, after, width > 0 ? Math.min(Math.max((time - frames[before]) / width, 0), 1) : 0];
  }

  /* Pressure of each cell, or stress below each vertex, from 0 to 1 of the largest. */
  function sharesAt(time, bytes, values) {
    const [before, after, share] = framesAt(time), count = values.length;
    for (let n = 0; n < count; n++) {
      const low = bytes[before * count + n], high = bytes[after * count + n];
      values[n] = (low + share * (high - low)) / 255;
    }
    return values;
  }

  function rgb(colour) {
    return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
  }

  /* Skin that is darker the more it carries, also in print without colour. */
  function darker(skin, share) {
    return skin.map((part, k) => Math.round(part + share * (DARK[k] - part)));
  }

  class View {
    constructor(stage, hidden) {
      this.canvas = make("canvas", "", stage);
      this.canvas.setAttribute("role", "img");
      this.hidden = hidden; /* classes that are not shown */
      if (!arrays.pressure) return;
      this.cells = new Float32Array(arrays.pressure.shape[1]);
      this.vertices = new Float32Array(arrays.stress.shape[1]);
    }

    /* Fills `cells` or `vertices`, what is shown, and clears the other. */
    fill(time) {
      if (quantity === "pressure") sharesAt(time, arrays.pressure, this.cells);
      else this.cells.fill(0);
      if (quantity === "stress") sharesAt(time, arrays.stress, this.vertices);
      else this.vertices.fill(0);
    }

    /* Size of a unit from 0 to 1: what never fires is small. */
    sizeOf(model, unit, brightness) {
      const rest = model.spikes.of[unit].length ? 0.3 : 0.14;
      return Math.max(rest, brightness[unit] > 0 ? 0.55 + 0.45 * brightness[unit] : 0);
    }

    /* Marks of all units that are seen, those that fire last. */
    drawUnits(pen, model, time, chosen, factor) {
      const paint = colours(), brightness = model.spikes.lit(time, new Float32Array(DATA.units.length));
      const order = Array.from(brightness.keys()).filter((unit) => !this.isHidden(unit));
      order.sort((a, b) => this.sizeOf(model, a, brightness) - this.sizeOf(model, b, brightness));
      for (const unit of order) {
        const name = DATA.classes[arrays.unit_class[unit]], size = this.sizeOf(model, unit, brightness);
        trace(pen, MARKS[name] || "circle", ...this.project(unit), 8 * size * factor);
        pen.globalAlpha = brightness[unit] > 0 || unit === chosen ? 1 : model.spikes.of[unit].length ? 0.75 : 0.4;
        pen.fillStyle = paint[classOf(name)];
        pen.fill();
        if (unit === chosen || brightness[unit] > 0) {
          pen.strokeStyle = unit === chosen ? paint.ink : "#ffffff";
          pen.lineWidth = unit === chosen ? 2.5 : 1;
          pen.stroke();
        }
        pen.globalAlpha = 1;
      }
    }

    isHidden(unit) {
      return this.hidden.has(DATA.classes[arrays.unit_class[unit]]);
    }

    nearest(model, x, y) {
      let best = null, least = 14;
      for (let unit = 0; unit < DATA.units.length; unit++) {
        if (this.isHidden(unit)) continue;
        const [px, py] = this.project(unit), way = Math.hypot(px - x, py - y);
        if (way < least) [best, least] = [unit, way];
      }
      return best;
    }
  }

  class FromAbove extends View {
    frame() {
      const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
      const ends = [Infinity, -Infinity, Infinity, -Infinity];
      for (let n = 0; n < arrays.surface_mm.length; n += 3) {
        ends[0] = Math.min(ends[0], arrays.surface_mm[n]);
        ends[1] = Math.max(ends[1], arrays.surface_mm[n]);
        ends[2] = Math.min(ends[2], arrays.surface_mm[n + 2]);
        ends[3] = Math.max(ends[3], arrays.surface_mm[n + 2]);
      }
      this.scale = Math.min((width - 40) / (ends[1] - ends[0]), (height - 76) / (ends[3] - ends[2]));
      this.middle = [width / 2 - (this.scale * (ends[0] + ends[1])) / 2, height / 2 + 4 + (this.scale * (ends[2] + ends[3])) / 2];
    }

    at(x, z) {
      return [this.middle[0] + this.scale * x, this.middle[1] - this.scale * z];
    }

    project(unit) {
      return this.at(arrays.unit_mm[3 * unit], arrays.unit_mm[3 * unit + 2]);
    }

    /* Fills triangles; those of nearly the same share of the largest are one shape. */
    fillAll(pen, vertices, triangles, shareOf, skin) {
      const paths = new Map();
      for (let n = 0; 3 * n < triangles.length; n++) {
        const level = Math.round(LEVELS * shareOf(n));
        if (!paths.has(level)) paths.set(level, new Path2D());
        const path = paths.get(level);
        for (let corner = 0; corner < 3; corner++) {
          const vertex = 3 * triangles[3 * n + corner], place = this.at(vertices[vertex], vertices[vertex + 2]);
          if (corner === 0) path.moveTo(...place);
          else path.lineTo(...place);
        }
        path.closePath();
      }
      for (const level of Array.from(paths.keys()).sort((x, y) => x - y)) {
        if (level < 0) continue;
        pen.fillStyle = pen.strokeStyle = "rgb(" + darker(skin, level / LEVELS).join() + ")";
        pen.fill(paths.get(level));
        pen.stroke(paths.get(level));
      }
    }

    draw(time, model, chosen) {
      const width = this.canvas.clientWidth, height = this.canvas.clientHeight, paint = colours();
      const pen = context(this.canvas, width, height);
      this.frame();
      pen.lineWidth = 0.7;
      this.fill(time);
      const skin = rgb(paint.skin), { triangles } = arrays;
      const mean = (n) => (this.vertices[triangles[n]] + this.vertices[triangles[n + 1]] + this.vertices[triangles[n + 2]]) / 3;
      this.fillAll(pen, arrays.surface_mm, triangles, (n) => mean(3 * n), skin);
      const pressed = (n) => this.cells[arrays.cell_of_triangle[n]] || -1;
      this.fillAll(pen, arrays.cell_mm, arrays.cell_triangles, pressed, skin);
      this.drawUnits(pen, model, time, chosen, 1);
      const [x, y] = [20, height - 14];
      pen.fillStyle = paint.muted;
      pen.fillRect(x, y - 3, 5 * this.scale, 2);
      write(pen, "5 mm", x, y - 7, paint.muted, AXIS);
    }
  }

  class InSpace extends View {
    constructor(stage, hidden, redraw) {
      super(stage, hidden);
      const three = window.fembridgeThree;
      this.three = three;
      this.renderer = new three.WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
      this.scene = new three.Scene();
      this.camera = new three.PerspectiveCamera(35, 1, 1, 500);
      this.build();
      this.controls = new three.OrbitControls(this.camera, this.canvas);
      this.controls.target.copy(this.middle);
      this.controls.addEventListener("change", redraw);
      this.scaleText = make("span", "scale", stage, "5 mm");
      this.overlay = make("canvas", "overlay", stage);
      const { unit_mm, unit_normal } = arrays, vector = (of, unit) => new three.Vector3(...of.slice(3 * unit, 3 * unit + 3));
      this.places = DATA.units.map((_, unit) => vector(unit_mm, unit));
      this.normals = DATA.units.map((_, unit) => vector(unit_normal, unit));
    }

    /* Units behind the finger are hidden. */
    isHidden(unit) {
      const away = this.camera.position.clone().sub(this.places[unit]);
      return super.isHidden(unit) || this.normals[unit].dot(away) < 0;
    }

    build() {
      const three = this.three;
      const geometry = new three.BufferGeometry();
      geometry.setAttribute("position", new three.BufferAttribute(arrays.surface_mm, 3));
      geometry.setIndex(new three.BufferAttribute(arrays.triangles, 1));
      geometry.computeVertexNormals();
      this.colours = new three.BufferAttribute(new Float32Array(arrays.surface_mm.length), 3);
      geometry.setAttribute("color", this.colours);
      this.skin = new three.MeshLambertMaterial({ side: 2, vertexColors: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
      this.scene.add(new three.Mesh(geometry, this.skin));
      const sun = new three.DirectionalLight(0xffffff, 2.1);
      sun.position.set(-6, 18, 9);
      this.scene.add(sun, new three.AmbientLight(0xffffff, 1.25));
      geometry.computeBoundingSphere();
      const { center, radius } = geometry.boundingSphere;
      geometry.computeBoundingBox();
      const { min, max } = geometry.boundingBox;
      this.middle = new three.Vector3(center.x, (center.y + max.y) / 2, center.z);
      this.radius = radius;
      this.corners = [min.x, max.x].flatMap((x) => [min.z, max.z].map((z) => new three.Vector3(x, (min.y + max.y) / 2, z)));
      /* Contact: each triangle has its own corners, so that a cell has one colour. */
      const corners = new Float32Array(3 * arrays.cell_triangles.length);
      arrays.cell_triangles.forEach((vertex, n) => {
        corners[3 * n] = arrays.cell_mm[3 * vertex];
        corners[3 * n + 1] = arrays.cell_mm[3 * vertex + 1] + 0.02;
        corners[3 * n + 2] = arrays.cell_mm[3 * vertex + 2];
      });
      this.contact = new three.BufferGeometry();
      this.contact.setAttribute("position", new three.BufferAttribute(corners, 3));
      this.contact.setAttribute("color", new three.BufferAttribute(new Float32Array((4 * corners.length) / 3), 4));
      const look = { vertexColors: true, transparent: true, side: 2, depthWrite: false };
      this.scene.add(new three.Mesh(this.contact, new three.MeshBasicMaterial(look)));
      const bar = new three.Mesh(new three.BoxGeometry(5, 0.06, 0.06), new three.MeshBasicMaterial({ color: 0x808080 }));
      this.barAt = new three.Vector3((min.x + max.x) / 2, min.y, max.z + 0.8);
      bar.position.copy(this.barAt);
      this.scene.add(bar);
      this.corners.push(this.barAt.clone().add(new three.Vector3(0, 0, 1.2)));
    }

    /* Moves the camera until all of the skin is seen. */
    fit() {
      this.way = 0;
      const direction = new this.three.Vector3(0, 2.5, 1.5).normalize();
      for (let way = this.radius; way < 8 * this.radius; way *= 1.04) {
        this.camera.position.copy(this.middle).addScaledVector(direction, way);
        this.camera.lookAt(this.middle);
        this.camera.updateMatrixWorld();
        this.way = way;
        const seen = this.corners.map((corner) => corner.clone().project(this.camera));
        if (seen.every((at) => Math.abs(at.x) < 0.94 && at.y > -0.9 && at.y < 0.88)) break;
      }
    }

    project(unit) {
      return this.onScreen(this.places[unit]);
    }

    onScreen(point) {
      const seen = point.clone().project(this.camera), { clientWidth, clientHeight } = this.canvas;
      return [((seen.x + 1) / 2) * clientWidth, ((1 - seen.y) / 2) * clientHeight];
    }

    draw(time, model, chosen) {
      const three = this.three, paint = colours(), { clientWidth, clientHeight } = this.canvas;
      const size = [clientWidth, clientHeight, window.devicePixelRatio].join();
      if (size !== this.size) {
        this.size = size;
        this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
        this.renderer.setSize(clientWidth, clientHeight, false);
        this.camera.aspect = clientWidth / Math.max(clientHeight, 1);
        this.camera.updateProjectionMatrix();
        if (!this.way) this.fit();
        this.controls.update();
      }
      this.fill(time);
      const base = new three.Color(paint.skin), dark = new three.Color("rgb(" + DARK.join() + ")"), mixed = new three.Color();
      this.vertices.forEach((share, n) => {
        mixed.copy(base).lerp(dark, share);
        this.colours.setXYZ(n, mixed.r, mixed.g, mixed.b);
      });
      this.colours.needsUpdate = true;
      const colour = this.contact.getAttribute("color"), shade = new three.Color();
      arrays.cell_of_triangle.forEach((cell, n) => {
        const share = this.cells[cell];
        shade.copy(base).lerp(dark, 0.15 + 0.85 * share);
        for (let corner = 3 * n; corner < 3 * n + 3; corner++) colour.setXYZW(corner, shade.r, shade.g, shade.b, share > 0 ? 1 : 0);
      });
      colour.needsUpdate = true;
      this.renderer.render(this.scene, this.camera);
      const pen = context(this.overlay, clientWidth, clientHeight);
      const way = this.camera.position.distanceTo(this.controls.target);
      this.drawUnits(pen, model, time, chosen, Math.sqrt(Math.min(this.way / way, 9)));
      const [x, y] = this.onScreen(this.barAt);
      Object.assign(this.scaleText.style, { left: x + "px", top: y + "px" });
    }
  }

  /* ---- Scene of a simulation: the section under the probe */

  class Section extends View {
    constructor(stage, hidden) {
      super(stage, hidden);
      this.still = document.createElement("canvas");
    }

    frame() {
      const { probe } = DATA.section, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
      const deepest = DATA.afferents.reduce((deep, { at_mm }) => (at_mm ? Math.min(deep, at_mm[1]) : deep), -1.2) - 0.5;
      const head_mm = 0.9, half_mm = Math.max(1.6, probe.diameter_mm);
      this.scale = Math.min(height / (head_mm - deepest), width / (2 * half_mm));
      this.middle = [width / 2 - this.scale * probe.x_mm, head_mm * this.scale];
    }

    at(x, y) {
      return [this.middle[0] + this.scale * x, this.middle[1] - this.scale * y];
    }

    drawSkin(width, height, paint) {
      const key = [width, height, window.devicePixelRatio, paint.page].join();
      if (key === this.drawn) return;
      this.drawn = key;
      const pen = context(this.still, width, height), { node_mm, quad, layer } = arrays;
      layer.forEach((of, n) => {
        pen.fillStyle = DATA.section.colours[of];
        pen.strokeStyle = pen.fillStyle;
        pen.lineWidth = 1.4;
        pen.beginPath();
        for (let corner = 0; corner < 4; corner++) {
          const node = 2 * quad[4 * n + corner];
          pen.lineTo(...this.at(node_mm[node], node_mm[node + 1]));
        }
        pen.closePath();
        pen.fill();
        pen.stroke();
      });
    }

    project(unit) {
      return this.places[unit];
    }

    draw(time, model) {
      const width = this.canvas.clientWidth, height = this.canvas.clientHeight, paint = colours();
      this.frame();
      this.drawSkin(width, height, paint);
      const pen = context(this.canvas, width, height);
      pen.drawImage(this.still, 0, 0, width, height);
      const depth_mm = valueAt(model.depth, 0, model.entry.depth_dt_ms, time) / 1000;
      const aside_mm = model.aside ? valueAt(model.aside, 0, model.entry.depth_dt_ms, time) / 1000 : 0;
      const line = arrays.probe_mm, last = line.length - 2;
      pen.beginPath();
      pen.moveTo(...this.at(line[0] + aside_mm, 9));
      for (let n = 0; n < line.length; n += 2) pen.lineTo(...this.at(line[n] + aside_mm, line[n + 1] - depth_mm));
      pen.lineTo(...this.at(line[last] + aside_mm, 9));
      pen.fillStyle = "rgba(77, 77, 77, 0.82)";
      pen.fill();
      const brightness = model.spikes.lit(time, new Float32Array(model.spikes.count));
      this.places = [];
      DATA.afferents.forEach((afferent, k) => {
        if (!afferent.at_mm) return;
        const [x, y] = this.at(...afferent.at_mm), colour = paint[classOf(afferent.class)];
        const curve = model.stress.subarray(k * model.samples, (k + 1) * model.samples);
        const stress = valueAt(curve, model.entry.start_ms, model.entry.stress_dt_ms, time) / 1000;
        let lit = 0;
        for (let cell = 0; cell < afferent.cells; cell++) {
          this.places[model.first[k] + cell] = [x, y];
          lit += brightness[model.first[k] + cell];
        }
        if (lit > 0) {
          pen.beginPath();
          pen.arc(x, y, 8 + 9 * Math.min(Math.sqrt(lit), 2.5), 0, 2 * Math.PI);
          pen.globalAlpha = 0.3;
          pen.fillStyle = colour;
          pen.fill();
          pen.globalAlpha = 1;
        }
        trace(pen, MARKS[afferent.class] || "circle", x, y, 7);
        pen.fillStyle = colour;
        pen.fill();
        pen.strokeStyle = "#ffffff";
        pen.lineWidth = 1.5;
        pen.stroke();
        const label = afferent.name + "  " + short(stress, 3) + " kPa";
        const left = k % 2 === 0 ? -16 : 16;
        pen.lineWidth = 4;
        pen.lineJoin = "round";
        pen.strokeStyle = "rgba(255, 255, 255, 0.85)";
        pen.font = "bold 14px " + getComputedStyle(document.body).fontFamily;
        pen.textAlign = left < 0 ? "right" : "left";
        pen.strokeText(label, x + left, y + 5);
        write(pen, label, x + left, y + 5, { SA: "#00694a", RA: "#005b8f", PC: "#a04400" }[afferent.class] || "#1a1a1a", 14, pen.textAlign, "bold");
      });
      const mm = 0.5 * this.scale;
      pen.fillStyle = "#1a1a1a";
      pen.fillRect(16, height - 16, mm, 2);
      write(pen, "0.5 mm", 16, height - 22, "#1a1a1a", AXIS);
      write(pen, "skin as it is without the probe", width - 14, height - 14, "#1a1a1a", AXIS, "right");
    }

    nearest(model, x, y) {
      let best = null;
      (this.places || []).forEach((place, unit) => {
        if (best === null && Math.hypot(place[0] - x, place[1] - y) < 14) best = unit;
      });
      return best;
    }
  }

  /* ---- The page */

  const isTouch = DATA.kind === "touch";
  const hidden = new Set();
  let quantity = "stress";
  root.replaceChildren();
  const choices = isTouch
    ? Array.from({ length: DATA.trials }, (_, k) => ["trial " + (k + 1), () => touchModel(k + 1)])
    : DATA.stimuli.map((entry, row) => [entry.id, () => stimulusModel(row)]);
  const panels = make("div", "panels", root), figure = make("figure", "scene", panels), stage = make("div", "stage", figure);
  const status = make("div", "status", null), tip = make("div", "tip", figure), message = make("p", "message", null);
  tip.hidden = message.hidden = true;
  const canvas = make("canvas", "plots", make("div", "", panels)), plots = new Plots(canvas);
  canvas.setAttribute("role", "img");
  const transport = make("div", "transport", root);
  const play = make("button", "play", transport, "Play");
  play.type = "button";
  const slider = make("input", "", transport);
  Object.assign(slider, { type: "range", min: 0, max: 2000, step: 1 });
  slider.setAttribute("aria-label", "Time");
  const clock = make("output", "", transport);
  const speed = make("select", "", transport);
  speed.setAttribute("aria-label", "Speed");
  for (const factor of SPEEDS) {
    const option = make("option", "", speed, factor === 1 ? "real time" : "1/" + Math.round(1 / factor) + " speed");
    option.value = factor;
  }
  const chooser = make("select", "", transport);
  chooser.setAttribute("aria-label", isTouch ? "Trial" : "Stimulus");
  choices.forEach(([name], k) => (make("option", "", chooser, name).value = k));
  chooser.hidden = choices.length < 2;

  const state = { time: 0, playing: false, chosen: null, model: null };
  let view = null, waits = false, inSpace = null, fromAbove = null;

  function later() {
    if (waits) return;
    waits = true;
    requestAnimationFrame(() => {
      waits = false;
      draw();
    });
  }

  function draw() {
    const { model, time } = state;
    if (view) view.draw(time, model, state.chosen);
    plots.draw(time);
    const share = (time - model.start_ms) / (model.end_ms - model.start_ms);
    if (document.activeElement !== slider || state.playing) slider.value = 2000 * share;
    const decimals = model.end_ms - model.start_ms < 100 ? 1 : 0;
    clock.textContent = time.toFixed(decimals) + " of " + short(model.end_ms, 4) + " ms";
    slider.setAttribute("aria-valuetext", clock.textContent);
    const brightness = model.spikes.lit(time, new Float32Array(model.spikes.count));
    const lit = brightness.reduce((count, value) => count + (value > 0), 0);
    const parts = model.bands
      .filter((band) => band.values && !band.filled)
      .map((band) => short(valueAt(band.values, band.start, band.step, time), 3).replace("-", "−") + " " + band.unit);
    parts.push(lit + (isTouch ? " units" : " cells") + " fired in the last " + LIT_MS + " ms");
    status.textContent = parts.join(" · ");
  }

  function step(before) {
    requestAnimationFrame((now) => {
      if (!state.playing) return;
      state.time += (now - before) * Number(speed.value);
      if (state.time >= state.model.end_ms) {
        state.time = state.model.end_ms;
        setPlaying(false);
      }
      draw();
      step(now);
    });
  }

  function setPlaying(playing) {
    state.playing = playing;
    play.textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    if (state.time >= state.model.end_ms - 1e-6) state.time = state.model.start_ms;
    step(performance.now());
  }

  function moveTo(time) {
    state.time = Math.min(Math.max(time, state.model.start_ms), state.model.end_ms);
    later();
  }

  function choose(row) {
    state.model = choices[row][1]();
    state.chosen = null;
    plots.show(state.model);
    const span = state.model.end_ms - state.model.start_ms, wanted = span / 1000 / PLAYED_S;
    const nearest = SPEEDS.map((factor) => Math.abs(Math.log(factor / wanted)));
    speed.value = SPEEDS[nearest.indexOf(Math.min(...nearest))];
    const rows = state.model.bands.filter((band) => band.rows).map((band) => band.title + " " + (band.note.includes("fire") ? band.note : band.right || ""));
    canvas.setAttribute("aria-label", "Over time: " + rows.join("; "));
    moveTo(state.model.first_ms);
  }

  function tell(unit, x, y) {
    state.chosen = unit;
    tip.hidden = unit === null;
    if (unit !== null) {
      tip.textContent = state.model.tell(unit);
      const box = figure.getBoundingClientRect(), width = tip.offsetWidth;
      const left = Math.min(Math.max(x - box.left + 14, 4), Math.max(window.innerWidth - box.left - width - 8, 4));
      Object.assign(tip.style, { left: left + "px", top: Math.max(y - box.top - 34, 4) + "px" });
    }
    later();
  }

  function hover(target) {
    target.addEventListener("pointermove", (event) => {
      if (event.buttons) return;
      const unit = view.nearest(state.model, event.offsetX, event.offsetY);
      if (unit !== state.chosen || unit !== null) tell(unit, event.clientX, event.clientY);
    });
    target.addEventListener("pointerleave", () => tell(null));
  }

  function setView(next) {
    view = next;
    for (const each of [inSpace, fromAbove]) if (each) each.canvas.hidden = each !== view;
    if (inSpace) inSpace.scaleText.hidden = inSpace.overlay.hidden = view !== inSpace;
    for (const button of stage.querySelectorAll(".views button"))
      button.setAttribute("aria-pressed", String((button.value === "above") === (view === fromAbove)));
    if (state.model) later();
  }

  if (isTouch) {
    fromAbove = new FromAbove(stage, hidden);
    try {
      inSpace = new InSpace(stage, hidden, later);
    } catch (error) {
      stage.querySelectorAll("canvas").forEach((each) => each !== fromAbove.canvas && each.remove());
      inSpace = null;
      message.textContent = "This browser has no WebGL: the skin is shown from above.";
      message.hidden = false;
      message.style.textAlign = "right";
    }
    for (const each of [inSpace, fromAbove]) {
      if (!each) continue;
      each.canvas.setAttribute("aria-label", "The skin with contact pressure and firing units");
      hover(each.canvas);
    }
    if (inSpace) {
      const views = make("div", "views", stage);
      for (const [value, text, each] of [["space", "3D", inSpace], ["above", "From above", fromAbove]]) {
        const button = make("button", "", views, text);
        Object.assign(button, { type: "button", value });
        button.addEventListener("click", () => setView(each));
      }
    }
    const legend = make("div", "legend", figure);
    for (const name of DATA.classes) {
      const label = make("label", "", legend), box = make("input", "", label);
      Object.assign(box, { type: "checkbox", checked: true });
      const drawn = { circle: '<circle cx="7" cy="7" r="6"/>', triangle: '<path d="M7 0.5 13.5 13H0.5Z"/>', square: '<rect x="1" y="1" width="12" height="12"/>' };
      const icon = make("span", "", label);
      icon.innerHTML = '<svg viewBox="0 0 14 14" aria-hidden="true">' + drawn[MARKS[name] || "circle"] + "</svg>";
      icon.style.fill = "var(--" + classOf(name) + ")";
      make("span", "", label, name);
      box.addEventListener("change", () => {
        if (box.checked) hidden.delete(name);
        else hidden.add(name);
        later();
      });
    }
    const bar = make("div", "bar", legend, "0");
    make("span", "", bar);
    const most = make("b", "", bar), shown = make("select", "", bar);
    shown.setAttribute("aria-label", "Quantity on the skin");
    for (const [value, text] of [["stress", "stress at SA"], ["pressure", "contact pressure"]]) make("option", "", shown, text).value = value;
    const select = () => {
      quantity = shown.value;
      most.textContent = short(quantity === "stress" ? DATA.most_stress_kpa : DATA.most_kpa, 3) + " kPa";
      if (state.model) later();
    };
    shown.addEventListener("change", select);
    select();
    setView(inSpace || fromAbove);
  } else if (DATA.section) {
    view = new Section(stage, hidden);
    view.canvas.setAttribute("aria-label", "Section of the finger under the probe, with its afferents");
    hover(view.canvas);
    const legend = make("div", "legend", figure);
    DATA.section.layers.forEach((name, n) => {
      if (!arrays.layer.includes(n) || /bone|nail/.test(name)) return;
      const label = make("span", "", legend), icon = make("span", "", label);
      icon.innerHTML = '<svg viewBox="0 0 14 14" aria-hidden="true"><rect x="1" y="1" width="12" height="12" stroke="#808080" stroke-width="0.6" fill="' + DATA.section.colours[n] + '"/></svg> ';
      label.append(name);
    });
  } else {
    panels.style.gridTemplateColumns = "minmax(0, 1fr)";
    figure.hidden = true;
  }
  stage.append(status, message);

  play.addEventListener("click", () => setPlaying(!state.playing));
  slider.addEventListener("input", () => {
    setPlaying(false);
    const { start_ms, end_ms } = state.model;
    moveTo(start_ms + (slider.value / 2000) * (end_ms - start_ms));
  });
  chooser.addEventListener("change", () => choose(Number(chooser.value)));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    setPlaying(false);
    moveTo(plots.timeOf(event.offsetX));
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) moveTo(plots.timeOf(event.offsetX));
    else tell(plots.unitAt(event.offsetY), event.clientX, event.clientY);
  });
  canvas.addEventListener("pointerleave", () => tell(null));
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || /BUTTON|SELECT|INPUT/.test(event.target.tagName)) return;
    event.preventDefault();
    setPlaying(!state.playing);
  });
  new ResizeObserver(later).observe(root);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", later);
  choose(0);
  draw();
  window.fembridgeExplorer = { state, arrays, DATA, moveTo, draw, setPlaying, isInSpace: () => view === inSpace && inSpace !== null };
})();

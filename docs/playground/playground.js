/* The playground: a waveform of the probe, the stress it makes and the spikes of all cells.

   The arithmetic is in playground.wasm, that of fembridge itself; this file makes the waveform,
   draws, and listens. It fills each element of the class "fembridge-playground". */
(function () {
  "use strict";

  const DATA = /*DATA*/ null;
  const STARTED_MS = performance.now();
  const STEP_MS = DATA.step_ms, DECIMALS = 1e6;
  const FILE_MS = 0.5, FINER = Math.round(FILE_MS / STEP_MS); /* samples of a waveform file */
  const DURATION_MS = 250, REST_MS = 50, TAPER_MS = 5, OWN_MS = 500, SMOOTH_MS = 2;
  const LONG_MS = [5, 250], SHORT_MS = [100, 200], SLOW_SINE_HZ = 50;

  const KINDS = {
    sine: {
      title: "Sinusoid",
      sliders: ["amplitude_um", "frequency_hz"],
      hint: "Drag the curve: up for amplitude, sideways for frequency.",
    },
    diharm: {
      title: "Two sinusoids",
      sliders: ["amplitude1_um", "frequency1_hz", "amplitude2_um", "frequency2_hz"],
      hint: "Drag the curve: up for both amplitudes, sideways for the second frequency.",
    },
    noise: {
      title: "Noise",
      sliders: ["rms_um", "low_hz", "high_hz"],
      hint: "Drag the curve: up for the level, sideways for the upper limit.",
    },
    ramp: {
      title: "Press and hold",
      sliders: ["depth_um", "up_ms", "hold_ms"],
      hint: "Drag the curve: up for depth, sideways for the time of the ramps.",
    },
    own: { title: "Draw your own", sliders: [], hint: "Draw here with the mouse, a pen or a finger." },
  };

  /* Label, unit, smallest, largest, whether logarithmic. */
  const SLIDERS = {
    amplitude_um: ["Amplitude", "µm", 0.5, 300, true],
    frequency_hz: ["Frequency", "Hz", 2, 500, true],
    amplitude1_um: ["Amplitude 1", "µm", 0.5, 200, true],
    frequency1_hz: ["Frequency 1", "Hz", 2, 500, true],
    amplitude2_um: ["Amplitude 2", "µm", 0.5, 200, true],
    frequency2_hz: ["Frequency 2", "Hz", 2, 500, true],
    rms_um: ["Level (RMS)", "µm", 0.5, 100, true],
    low_hz: ["From", "Hz", 2, 400, true],
    high_hz: ["To", "Hz", 10, 500, true],
    depth_um: ["Depth", "µm", 5, 350, true],
    up_ms: ["Ramp", "ms", 5, 200, true],
    hold_ms: ["Hold", "ms", 10, 500, true],
    preindent_um: ["Resting depth", "µm", 0, 250, false],
  };
  const DRAGGED = {
    sine: [["amplitude_um"], ["frequency_hz"]],
    diharm: [["amplitude1_um", "amplitude2_um"], ["frequency2_hz"]],
    noise: [["rms_um"], ["high_hz"]],
    ramp: [["depth_um"], ["up_ms"]],
  };

  /* ---- The waveform */

  function rounded(value) {
    const scaled = value * DECIMALS, whole = Math.round(scaled);
    const tie = Math.abs(scaled - Math.trunc(scaled)) === 0.5;
    return (tie ? 2 * Math.round(scaled / 2) : whole) / DECIMALS;
  }

  function sine(frequency_hz, time_ms) {
    return Math.sin(2.0 * Math.PI * ((frequency_hz * time_ms) / 1000.0));
  }

  /* Numbers from 0 to 1 (mulberry32). */
  function randomNumbers(seed) {
    let state = seed >>> 0;
    return function () {
      state = (state + 0x6d2b79f5) >>> 0;
      let value = Math.imul(state ^ (state >>> 15), 1 | state);
      value = (value + Math.imul(value ^ (value >>> 7), 61 | value)) ^ value;
      return ((value ^ (value >>> 14)) >>> 0) / 4294967296;
    };
  }

  /* Gaussian noise in a band: sinusoids of random phase and amplitude, 1 Hz apart. */
  function noise(values, samples) {
    const next = randomNumbers(values.seed), wave = new Float64Array(samples);
    const low = Math.min(values.low_hz, values.high_hz / 1.1), high = values.high_hz;
    const spacing = Math.max(1, (high - low) / 200);
    const first = Math.max(spacing, low * 0.6), last = Math.min(high * 1.5, 1000);
    for (let hz = first; hz <= last; hz += spacing) {
      const warped = (hz * hz - low * high) / (hz * (high - low));
      const gain = 1 / (1 + Math.pow(warped, 8));
      const size = gain * Math.sqrt(-2 * Math.log(1 - next())), phase = 2 * Math.PI * next();
      const turn = (2 * Math.PI * hz * FILE_MS) / 1000;
      const cosine = 2 * Math.cos(turn); /* sin((n + 1) w) = 2 cos(w) sin(n w) - sin((n - 1) w) */
      let before = size * Math.sin(phase - turn), now = size * Math.sin(phase);
      for (let n = 0; n < samples; n++) {
        wave[n] += now;
        const after = cosine * now - before;
        before = now;
        now = after;
      }
    }
    let square = 0;
    for (let n = 0; n < samples; n++) {
      const part = Math.min((n * FILE_MS) / TAPER_MS, 1);
      wave[n] *= 0.5 * (1 - Math.cos(Math.PI * part));
      square += wave[n] * wave[n];
    }
    const factor = values.rms_um / Math.sqrt(square / samples);
    for (let n = 0; n < samples; n++) wave[n] *= factor;
    return wave;
  }

  /* Depths drawn every ms, smoothed by a Gaussian. */
  function smoothed(points, samples) {
    const finer = Math.round(1 / FILE_MS), reach = Math.round((3 * SMOOTH_MS) / FILE_MS);
    const weights = [];
    let sum = 0;
    for (let k = -reach; k <= reach; k++) {
      weights.push(Math.exp(-0.5 * Math.pow((k * FILE_MS) / SMOOTH_MS, 2)));
      sum += weights[weights.length - 1];
    }
    const fine = new Float64Array(samples + 2 * reach), wave = new Float64Array(samples);
    for (let n = 0; n < fine.length; n++) {
      const at = Math.min(Math.max(n - reach, 0), samples - 1) / finer, low = Math.floor(at);
      const high = Math.min(low + 1, points.length - 1);
      fine[n] = points[low] + (at - low) * (points[high] - points[low]);
    }
    for (let n = 0; n < samples; n++) {
      let value = 0;
      for (let k = 0; k < weights.length; k++) value += weights[k] * fine[n + k];
      wave[n] = value / sum;
    }
    return wave;
  }

  /* FINER samples for each of `coarse`, by SciPy's PCHIP, as the program reads a file. */
  function interpolated(coarse) {
    const last = coarse.length - 1, slope = new Float64Array(last), rise = new Float64Array(last + 1);
    for (let n = 0; n < last; n++) slope[n] = coarse[n + 1] - coarse[n];
    for (let n = 1; n < last; n++)
      if (slope[n - 1] * slope[n] > 0) rise[n] = 1 / ((3 / slope[n - 1] + 3 / slope[n]) / 6);
    const end = function (near, far) {
      const value = (3 * near - far) / 2;
      if (Math.sign(value) !== Math.sign(near)) return 0;
      return Math.sign(near) !== Math.sign(far) && Math.abs(value) > 3 * Math.abs(near) ? 3 * near : value;
    };
    rise[0] = end(slope[0], slope[1]);
    rise[last] = end(slope[last - 1], slope[last - 2]);
    const fine = new Float64Array(last * FINER + 1);
    fine[last * FINER] = coarse[last];
    for (let n = 0; n < last; n++) {
      const excess = rise[n] + rise[n + 1] - 2 * slope[n], bend = slope[n] - rise[n] - excess;
      fine[n * FINER] = coarse[n];
      for (let k = 1; k < FINER; k++) {
        const s = (n * FINER + k) * (1 / FINER) - n;
        fine[n * FINER + k] = coarse[n] + rise[n] * s + bend * (s * s) + excess * (s * s * s);
      }
    }
    return fine;
  }

  /* Depth of the probe in um every STEP_MS, that of its file, and the window in which spikes count. */
  function waveform(state) {
    const ramp_ms = 3 * REST_MS + 2 * state.up_ms + state.hold_ms;
    const duration_ms = { ramp: ramp_ms, own: OWN_MS }[state.kind] || DURATION_MS;
    const file_samples = Math.round(duration_ms / FILE_MS) + 1;
    let window_ms = LONG_MS, wave = null, is_cut = false;
    if (state.kind === "noise") wave = noise(state, file_samples);
    if (state.kind === "own") wave = smoothed(state.own_um, file_samples);
    if (state.kind === "sine" && state.frequency_hz >= SLOW_SINE_HZ) window_ms = SHORT_MS;
    if (state.kind === "ramp" || state.kind === "own") window_ms = [0, duration_ms];
    const fall_ms = REST_MS + state.up_ms + state.hold_ms, speed = state.depth_um / state.up_ms;
    const valueOf = {
      sine: (t) => state.amplitude_um * sine(state.frequency_hz, t),
      diharm: (t) =>
        state.amplitude1_um * sine(state.frequency1_hz, t) +
        state.amplitude2_um * sine(state.frequency2_hz, t),
      ramp: function (t) {
        const down = state.depth_um - (t - fall_ms) * speed;
        return Math.max(0, Math.min((t - REST_MS) * speed, state.depth_um, down));
      },
    }[state.kind];
    const rest_um = state.kind === "own" ? 0 : state.preindent_um;
    const depths = (step_ms) =>
      Float64Array.from({ length: Math.round(duration_ms / step_ms) + 1 }, function (_, n) {
        const depth = rounded(rest_um + rounded(wave ? wave[n] : valueOf(n * step_ms)));
        is_cut = is_cut || depth > DATA.deepest_um;
        return Math.min(depth, DATA.deepest_um);
      });
    /* What no id names is a file: noise, a drawing, and a waveform that was cut. */
    let file_um = wave ? null : depths(STEP_MS);
    const is_file = Boolean(wave || is_cut);
    if (is_file) file_um = depths(FILE_MS);
    const depth_um = is_file ? interpolated(file_um) : file_um;
    return { depth_um, file_um, is_file, step_ms: is_file ? FILE_MS : STEP_MS, window_ms, duration_ms, is_cut };
  }

  /* ---- Stress and spikes */

  function bytes(text) {
    const binary = atob(text), array = new Uint8Array(binary.length);
    for (let k = 0; k < binary.length; k++) array[k] = binary.charCodeAt(k);
    return array;
  }

  let encoder = null;
  const loading = WebAssembly.instantiate(bytes(DATA.wasm), {}).then(function (loaded) {
    const module = loaded.instance.exports, memory = module.memory;
    const coefficients = new Float64Array(bytes(DATA.coefficients).buffer);
    new Float64Array(memory.buffer, module.polynomial(), coefficients.length).set(coefficients);
    new Float64Array(memory.buffer, module.knot_um(), DATA.knot_um.length).set(DATA.knot_um);
    const most = module.most_samples();
    encoder = function (depth_um) {
      const samples = depth_um.length;
      if (samples > most) throw new RangeError(samples + " samples, expected at most " + most);
      new Float64Array(memory.buffer, module.depth_um(), samples).set(depth_um);
      const count = module.encode(samples, DATA.knot_um.length);
      if (count < 0) throw new RangeError("too many spikes");
      const at = new Int32Array(memory.buffer, module.spike_sample(), count);
      const cell = new Int32Array(memory.buffer, module.spike_cell(), count);
      let first = 0;
      return DATA.afferents.map(function (afferent, k) {
        const cells = Array.from({ length: afferent.cells }, () => []);
        for (let n = 0; n < count; n++) {
          const row = cell[n] - first;
          if (row >= 0 && row < afferent.cells) cells[row].push(at[n] * STEP_MS);
        }
        first += afferent.cells;
        const address = module.stress_pa() + 8 * most * k;
        const stress_pa = new Float64Array(memory.buffer, address, samples).slice();
        return { name: afferent.name, stress_pa, cells };
      });
    };
    return encoder;
  });

  function rateIps(cells, window_ms) {
    const edge_ms = 1e-6;
    let count = 0;
    for (const times of cells)
      for (const time of times)
        if (time > window_ms[0] + edge_ms && time <= window_ms[1] + edge_ms) count++;
    return (count * 1000) / (cells.length * (window_ms[1] - window_ms[0]));
  }

  /* ---- Text */

  function short(value) {
    const size = Math.abs(value);
    const text = value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : 2);
    return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
  }

  function idNumber(value) {
    return value.toFixed(6).replace(/\.?0+$/, "");
  }

  function stimulusId(state) {
    const names = {
      sine: ["frequency_hz", "amplitude_um"],
      diharm: ["frequency1_hz", "frequency2_hz", "amplitude1_um", "amplitude2_um"],
      ramp: ["depth_um", "up_ms", "hold_ms", "up_ms"],
    }[state.kind];
    return names ? [state.kind].concat(names.map((name) => idNumber(state[name]))).join("_") : null;
  }

  /* The command that repeats the picture; a waveform without an id is a file. */
  function commandLine(state, wave) {
    const id = wave.is_file ? null : stimulusId(state), words = ["fembridge simulate --stimulus"];
    words.push(id || "waveform.csv");
    const rest_um = id ? state.preindent_um : wave.depth_um[0];
    if (id ? rest_um !== DATA.preindent_um : rest_um === 0)
      words.push("--preindent-um " + idNumber(rest_um));
    return words.join(" ");
  }

  function table(wave) {
    const rows = ["time_ms,displacement_um"];
    wave.file_um.forEach((depth, n) => rows.push(idNumber(n * wave.step_ms) + "," + idNumber(depth)));
    return rows.join("\n") + "\n";
  }

  /* ---- Drawing */

  const LEFT = 54, RIGHT = 14;

  function niceTop(value) {
    if (!(value > 0)) return 1;
    const power = Math.pow(10, Math.floor(Math.log10(value)));
    return [1, 2, 5, 10].map((k) => k * power).find((top) => top >= value * (1 - 1e-9));
  }

  function colours(element) {
    const style = getComputedStyle(element);
    const get = (name) => style.getPropertyValue("--playground-" + name).trim();
    const named = { ink: get("ink"), muted: get("muted"), faint: get("faint"), shade: get("shade") };
    for (const afferent of DATA.afferents) named[afferent.name] = get(afferent.name.toLowerCase());
    named.font = style.fontFamily;
    return named;
  }

  function context(canvas, height) {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    canvas.style.height = height + "px";
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    return [pen, width];
  }

  function write(pen, text, x, y, colour, size, align, weight) {
    pen.fillStyle = colour;
    pen.font = (weight || "normal") + " " + size + "px " + pen.family;
    pen.textAlign = align || "left";
    pen.fillText(text, x, y);
    return pen.measureText(text).width;
  }

  function line(pen, x0, y0, x1, y1, colour) {
    pen.strokeStyle = colour;
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(x0, y0);
    pen.lineTo(x1, y1);
    pen.stroke();
  }

  /* The curve of `values`: of several samples in one pixel the smallest and the largest. */
  function curve(pen, values, xOf, yOf, colour, width) {
    pen.beginPath();
    let from = 0;
    while (from < values.length) {
      const x = Math.round(xOf(from) * 2) / 2;
      let low = values[from], high = low, last = low, n = from;
      for (; n < values.length && Math.round(xOf(n) * 2) / 2 === x; n++) {
        low = Math.min(low, values[n]);
        high = Math.max(high, values[n]);
        last = values[n];
      }
      if (from === 0) pen.moveTo(x, yOf(values[0]));
      pen.lineTo(x, yOf(low));
      pen.lineTo(x, yOf(high));
      pen.lineTo(x, yOf(last));
      from = n;
    }
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.lineJoin = "round";
    pen.stroke();
  }

  const DESCRIPTIONS = { SA: "slowly adapting", RA: "rapidly adapting", PC: "Pacinian" };
  const WAVE_HEIGHT = 150, HEAD = 22, STRESS = 46, ROW = 6, GAP = 16, FOOT = 32;
  const AXIS = 12; /* letters of axes */

  class Playground {
    constructor(element) {
      this.element = element;
      this.linked = element.dataset.linked !== undefined;
      this.state = {
        kind: "sine",
        amplitude_um: 100,
        frequency_hz: 40,
        amplitude1_um: 60,
        frequency1_hz: 10,
        amplitude2_um: 8,
        frequency2_hz: 200,
        rms_um: 20,
        low_hz: 20,
        high_hz: 150,
        depth_um: 200,
        up_ms: 50,
        hold_ms: 200,
        preindent_um: DATA.preindent_um,
        seed: 1,
        own_um: Playground.firstDrawing(),
      };
      if (this.linked) this.readLink();
      this.cursor_ms = null;
      this.build();
      this.arrange();
      const redraw = () => this.later();
      new ResizeObserver(redraw).observe(this.wave);
      new MutationObserver(redraw).observe(document.documentElement, {
        attributes: true,
        attributeFilter: ["data-theme", "class"],
      });
      loading.then(() => this.update());
    }

    /* Two taps and a slow press. */
    static firstDrawing() {
      const bump = (t, at, width, size) => size * Math.exp(-0.5 * Math.pow((t - at) / width, 2));
      return Array.from({ length: OWN_MS + 1 }, function (_, t) {
        const press = 170 / (1 + Math.exp(-(t - 280) / 12)) / (1 + Math.exp((t - 430) / 18));
        return bump(t, 70, 10, 160) + bump(t, 150, 10, 110) + press + 20;
      });
    }

    /* ---- Elements */

    build() {
      const make = (tag, name, parent, text) => {
        const made = document.createElement(tag);
        if (name) made.className = "playground-" + name;
        if (text) made.textContent = text;
        (parent || this.element).append(made);
        return made;
      };
      this.element.replaceChildren();
      const kinds = make("fieldset", "kinds");
      make("legend", "hidden", kinds, "Stimulus");
      const group = "playground-" + Math.random().toString(36).slice(2);
      for (const [kind, { title }] of Object.entries(KINDS)) {
        const label = make("label", "", kinds), radio = make("input", "", label);
        Object.assign(radio, { type: "radio", name: group, value: kind });
        radio.checked = kind === this.state.kind;
        make("span", "", label, title);
        radio.addEventListener("change", () => this.set({ kind }));
      }
      const sliders = make("div", "sliders");
      this.sliders = {};
      for (const [name, [title, unit, low, high, log]] of Object.entries(SLIDERS)) {
        const label = make("label", "slider", sliders);
        const line = make("span", "", label);
        make("span", "", line, title);
        const output = make("span", "value", line), input = make("input", "", label);
        Object.assign(input, { type: "range", min: 0, max: 1000, step: 1 });
        if (!log) Object.assign(input, { min: low, max: high, step: 5 });
        input.addEventListener("input", () => {
          const share = input.value / 1000;
          const value = log ? low * Math.pow(high / low, share) : Number(input.value);
          this.set({ [name]: Number(value.toPrecision(value < 1 ? 1 : 2)) });
        });
        this.sliders[name] = { label, input, output, unit, low, high, log };
      }
      const row = make("div", "row");
      this.hint = make("p", "hint", row);
      const buttons = make("div", "buttons", row);
      this.again = make("button", "", buttons, "Another noise");
      this.again.addEventListener("click", () => this.set({ seed: this.state.seed + 1 }));
      this.clear = make("button", "", buttons, "Clear");
      this.clear.addEventListener("click", () => this.set({ own_um: this.state.own_um.map(() => 20) }));
      for (const button of [this.again, this.clear]) button.type = "button";
      this.wave = make("canvas", "wave");
      this.wave.tabIndex = 0;
      this.wave.setAttribute("role", "img");
      this.results = make("canvas", "results");
      this.results.setAttribute("role", "img");
      this.spoken = make("p", "hidden");
      this.spoken.setAttribute("aria-live", "polite");
      const foot = make("div", "foot");
      this.command = make("code", "", foot);
      const copy = make("button", "", foot, "Copy");
      const save = make("button", "", foot, "Save waveform");
      save.type = copy.type = "button";
      copy.addEventListener("click", () => this.copy(copy));
      save.addEventListener("click", () => {
        const link = document.createElement("a");
        const file = new Blob([table(this.current)], { type: "text/csv" });
        link.href = URL.createObjectURL(file);
        link.download = "waveform.csv";
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 1000);
      });
      this.listen();
    }

    copy(button) {
      const done = () => {
        button.textContent = "Copied";
        setTimeout(() => (button.textContent = "Copy"), 1200);
      };
      const select = () => getSelection().selectAllChildren(this.command);
      if (navigator.clipboard) {
        navigator.clipboard.writeText(this.command.textContent).then(done, select);
      } else {
        select();
      }
    }

    listen() {
      const wave = this.wave;
      let held = null;
      wave.addEventListener("pointerdown", (event) => {
        wave.setPointerCapture(event.pointerId);
        wave.focus({ preventScroll: true });
        held = { x: event.offsetX, y: event.offsetY, state: Object.assign({}, this.state) };
        if (this.state.kind === "own") this.draw(held, event);
        event.preventDefault();
      });
      wave.addEventListener("pointermove", (event) => {
        if (!held) return this.point(event.offsetX);
        if (this.state.kind === "own") {
          this.draw(held, event);
          [held.x, held.y] = [event.offsetX, event.offsetY];
        } else {
          this.drag(held, event.offsetX - held.x, held.y - event.offsetY);
        }
        return undefined;
      });
      for (const name of ["pointerup", "pointercancel", "lostpointercapture"])
        wave.addEventListener(name, () => (held = null));
      wave.addEventListener("keydown", (event) => this.press(event));
      this.results.addEventListener("pointermove", (event) => this.point(event.offsetX));
      for (const canvas of [wave, this.results])
        canvas.addEventListener("pointerleave", () => this.point(null));
    }

    /* Values of a drag: twice as much for 90 pixels upwards or 110 to the left. */
    drag(held, right, up) {
      const [upwards, sideways] = DRAGGED[this.state.kind], changes = {};
      const change = (name, factor) => {
        const { low, high } = this.sliders[name];
        const value = Math.min(high, Math.max(low, held.state[name] * factor));
        changes[name] = Number(value.toPrecision(value < 1 ? 1 : 3));
      };
      for (const name of upwards) change(name, Math.pow(2, up / 60));
      const sign = sideways[0].endsWith("_ms") ? 1 : -1; /* longer to the right, faster to the left */
      for (const name of sideways) change(name, Math.pow(2, (sign * right) / 110));
      this.set(changes);
    }

    draw(held, event) {
      const width = this.wave.clientWidth - LEFT - RIGHT;
      const timeOf = (x) => Math.round(Math.min(Math.max((x - LEFT) / width, 0), 1) * OWN_MS);
      const depthOf = (y) => {
        const part = (this.frame.bottom - y) / (this.frame.bottom - this.frame.top);
        return Math.min(Math.max(part * this.frame.high_um, 0), DATA.deepest_um);
      };
      const own_um = this.state.own_um.slice();
      const from = timeOf(held.x), to = timeOf(event.offsetX), step = from <= to ? 1 : -1;
      for (let t = from; t !== to + step; t += step) {
        const part = from === to ? 1 : (t - from) / (to - from);
        own_um[t] = depthOf(held.y + part * (event.offsetY - held.y));
      }
      this.set({ own_um });
    }

    /* Arrow keys on the curve: as dragging; of a drawing they move a mark and push the curve there. */
    press(event) {
      const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };
      if (!(event.key in step)) return;
      event.preventDefault();
      const [right, up] = step[event.key];
      if (this.state.kind !== "own") {
        this.drag({ state: this.state }, 8 * right, 8 * up);
        return;
      }
      this.cursor_ms = Math.min(Math.max((this.cursor_ms ?? 250) + 10 * right, 0), OWN_MS);
      const push = (depth, t) => {
        const size = 10 * up * Math.exp(-0.5 * Math.pow((t - this.cursor_ms) / 10, 2));
        return Math.min(Math.max(depth + size, 0), DATA.deepest_um);
      };
      if (up) this.set({ own_um: this.state.own_um.map(push) });
      else this.later();
    }

    point(x) {
      const width = this.wave.clientWidth - LEFT - RIGHT;
      const share = x === null ? -1 : (x - LEFT) / width;
      const inside = share >= 0 && share <= 1 && this.current;
      this.cursor_ms = inside ? share * this.current.duration_ms : null;
      this.later();
    }

    /* ---- State */

    set(changes) {
      Object.assign(this.state, changes);
      if ("low_hz" in changes) this.state.high_hz = Math.max(this.state.high_hz, round2(1.2 * this.state.low_hz));
      if ("high_hz" in changes) this.state.low_hz = Math.min(this.state.low_hz, round2(this.state.high_hz / 1.2));
      this.arrange();
      this.stale = true;
      this.later();
    }

    /* Shows the sliders of the stimulus. */
    arrange() {
      const { kind } = this.state, shown = new Set(KINDS[kind].sliders);
      if (kind !== "own") shown.add("preindent_um");
      for (const [name, slider] of Object.entries(this.sliders)) {
        const { label, input, output, unit, low, high, log } = slider, value = this.state[name];
        label.hidden = !shown.has(name);
        const share = log ? (1000 * Math.log(value / low)) / Math.log(high / low) : value;
        if (document.activeElement !== input || Math.abs(input.value - share) > 20) input.value = share;
        output.textContent = short(value) + " " + unit;
        input.setAttribute("aria-valuetext", short(value) + " " + unit);
      }
      this.again.hidden = kind !== "noise";
      this.clear.hidden = kind !== "own";
      this.hint.textContent = KINDS[kind].hint;
      this.wave.dataset.kind = kind;
      for (const radio of this.element.querySelectorAll("input[type=radio]"))
        radio.checked = radio.value === kind;
    }

    later() {
      if (this.waits) return;
      this.waits = true;
      requestAnimationFrame(() => {
        this.waits = false;
        if (encoder) this.update();
      });
    }

    update() {
      const started_ms = performance.now();
      if (!this.current || this.stale) {
        this.stale = false;
        this.current = waveform(this.state);
        this.current.afferents = encoder(this.current.depth_um);
        for (const afferent of this.current.afferents)
          afferent.rate_ips = rateIps(afferent.cells, this.current.window_ms);
        this.command.textContent = commandLine(this.state, this.current);
        this.speak();
        if (this.linked) this.writeLink();
      }
      const paint = colours(this.element);
      this.drawWave(paint);
      this.drawResults(paint);
      this.update_ms = performance.now() - started_ms;
      if (this.first_ms === undefined) this.first_ms = performance.now() - STARTED_MS;
    }

    speak() {
      clearTimeout(this.speaking);
      this.speaking = setTimeout(() => {
        const rates = this.current.afferents.map((a) => a.name + " " + a.rate_ips.toFixed(1));
        const depth_um = this.current.depth_um;
        const ends = [depth_um.reduce((a, b) => Math.min(a, b)), depth_um.reduce((a, b) => Math.max(a, b))];
        this.spoken.textContent = "Impulses per second: " + rates.join(", ") + ".";
        this.results.setAttribute("aria-label", "Stress and spikes. " + this.spoken.textContent);
        const text = "Depth of the probe, " + ends.map(short).join(" to ") + " micrometres. ";
        this.wave.setAttribute("aria-label", text + KINDS[this.state.kind].hint + " Arrow keys do the same.");
      }, 400);
    }

    /* ---- Pictures */

    timeAxis(pen, width, top, bottom, paint, labelled) {
      const { duration_ms } = this.current, scale = (width - LEFT - RIGHT) / duration_ms;
      const step = [50, 100, 200].find((size) => (duration_ms / size) * 60 < width) || 500;
      for (let time = 0; time <= duration_ms + 1e-6; time += step) {
        const x = LEFT + time * scale;
        line(pen, x, bottom, x, bottom + 4, paint.muted);
        if (labelled) write(pen, String(time), x, bottom + 16, paint.muted, AXIS, "center");
      }
      if (labelled) write(pen, "time in ms", LEFT + duration_ms * scale, bottom + 29, paint.muted, AXIS, "right");
    }

    shadeOutside(pen, width, top, bottom, paint) {
      const { duration_ms, window_ms } = this.current, scale = (width - LEFT - RIGHT) / duration_ms;
      pen.fillStyle = paint.shade;
      pen.fillRect(LEFT, top, window_ms[0] * scale, bottom - top);
      const end = LEFT + window_ms[1] * scale;
      pen.fillRect(end, top, LEFT + duration_ms * scale - end, bottom - top);
    }

    drawCursor(pen, width, top, bottom, paint) {
      if (this.cursor_ms === null) return;
      const x = LEFT + (this.cursor_ms / this.current.duration_ms) * (width - LEFT - RIGHT);
      line(pen, x, top, x, bottom, paint.muted);
    }

    drawWave(paint) {
      const [pen, width] = context(this.wave, WAVE_HEIGHT);
      pen.family = paint.font;
      const { depth_um, duration_ms, is_cut } = this.current;
      let low = 0, high = 50;
      for (const depth of depth_um) {
        low = Math.min(low, depth);
        high = Math.max(high, depth);
      }
      high = this.state.kind === "own" ? DATA.deepest_um : [50, 100, 150, 200, 300, 400].find((top) => top >= high);
      if (low < 0) low = -[10, 25, 50, 100, 150, 200, 300].find((top) => top >= -low);
      const top = 24, bottom = WAVE_HEIGHT - 8;
      this.frame = { top, bottom, high_um: high };
      const xOf = (n) => LEFT + ((n * STEP_MS) / duration_ms) * (width - LEFT - RIGHT);
      const yOf = (depth) => bottom - ((depth - low) / (high - low)) * (bottom - top);
      const used = write(pen, "Probe", LEFT, 14, paint.ink, 14, "left", "bold");
      let right = is_cut ? "as deep as the stored response: " + short(DATA.deepest_um) + " µm" : "";
      if (this.cursor_ms !== null) {
        const n = Math.min(Math.round(this.cursor_ms / STEP_MS), depth_um.length - 1);
        right = short(depth_um[n]) + " µm at " + short(this.cursor_ms) + " ms";
      }
      const note = "depth in µm" + (low < 0 && width > 520 ? "; below 0 off the skin" : "");
      if (width > 520 || !is_cut || this.cursor_ms !== null) write(pen, note, LEFT + used + 8, 14, paint.muted, 13);
      write(pen, right, width - RIGHT, 14, paint.ink, 13, "right");
      this.shadeOutside(pen, width, top, bottom, paint);
      for (const value of low < 0 ? [low, 0, high] : [0, high / 2, high]) {
        if (value < 0 && bottom - yOf(0) < 13) continue;
        const y = Math.round(yOf(value)) + 0.5;
        line(pen, LEFT, y, width - RIGHT, y, value === 0 ? paint.muted : paint.faint);
        write(pen, String(value).replace("-", "−"), LEFT - 6, y + 4, paint.muted, AXIS, "right");
      }
      curve(pen, depth_um, xOf, yOf, paint.ink, 2);
      this.drawCursor(pen, width, top, bottom, paint);
    }

    drawResults(paint) {
      const bands = this.current.afferents.map((a) => HEAD + STRESS + 8 + a.cells.length * ROW);
      const height = bands.reduce((a, b) => a + b + GAP, 0) - GAP + FOOT;
      const [pen, width] = context(this.results, height);
      pen.family = paint.font;
      const { duration_ms } = this.current, scale = (width - LEFT - RIGHT) / duration_ms;
      const xOf = (n) => LEFT + n * STEP_MS * scale;
      let y = 0;
      this.current.afferents.forEach((afferent, k) => {
        const colour = paint[afferent.name], top = y + HEAD, base = top + STRESS;
        const end = base + 8 + afferent.cells.length * ROW;
        const peak = afferent.stress_pa.reduce((a, b) => Math.max(a, b), 0), full = niceTop(peak / 1000);
        const used = write(pen, afferent.name, LEFT, y + 14, colour, 14, "left", "bold");
        const stress = "stress in kPa";
        write(pen, width > 520 ? DESCRIPTIONS[afferent.name] + ", " + stress : stress, LEFT + used + 8, y + 14, paint.muted, 13);
        const unit = write(pen, " impulses/s", width - RIGHT, y + 14, paint.muted, 13, "right");
        write(pen, afferent.rate_ips.toFixed(1), width - RIGHT - unit, y + 14, colour, 15, "right", "bold");
        this.shadeOutside(pen, width, top, end, paint);
        const yOf = (stress_pa) => base - (stress_pa / 1000 / full) * STRESS;
        write(pen, String(full), LEFT - 6, top + 6, paint.muted, AXIS, "right");
        write(pen, "0", LEFT - 6, base + 3, paint.muted, AXIS, "right");
        line(pen, LEFT, top + 0.5, width - RIGHT, top + 0.5, paint.faint);
        line(pen, LEFT, base + 0.5, width - RIGHT, base + 0.5, paint.faint);
        pen.globalAlpha = 0.16;
        pen.fillStyle = colour;
        pen.beginPath();
        pen.moveTo(LEFT, base);
        for (let n = 0; n < afferent.stress_pa.length; n += 2) pen.lineTo(xOf(n), yOf(afferent.stress_pa[n]));
        pen.lineTo(width - RIGHT, base);
        pen.fill();
        pen.globalAlpha = 1;
        curve(pen, afferent.stress_pa, xOf, yOf, colour, 1.25);
        pen.fillStyle = colour;
        afferent.cells.forEach((times, row) => {
          for (const time of times) pen.fillRect(LEFT + time * scale - 1, base + 6 + row * ROW, 2, ROW - 1);
        });
        write(pen, afferent.cells.length + " cells", LEFT - 6, (base + end) / 2 + 7, paint.muted, 11, "right");
        if (k === this.current.afferents.length - 1) this.timeAxis(pen, width, top, end, paint, true);
        this.drawCursor(pen, width, top, end, paint);
        y = end + GAP;
      });
      const [start, stop] = this.current.window_ms;
      const note = "rates: mean of all cells, " + short(start) + " to " + short(stop) + " ms";
      if (width > 480) write(pen, note, LEFT, height - 3, paint.muted, AXIS);
    }

    /* ---- The address of the full page has the state */

    readLink() {
      for (const [name, text] of new URLSearchParams(location.hash.slice(1))) {
        if (name === "kind" && text in KINDS) this.state.kind = text;
        if (name === "seed" && Number(text) > 0) this.state.seed = Math.round(Number(text));
        if (!(name in SLIDERS) || !Number.isFinite(Number(text))) continue;
        const [, , low, high] = SLIDERS[name];
        this.state[name] = Math.min(high, Math.max(low, Number(text)));
      }
    }

    writeLink() {
      clearTimeout(this.linking);
      this.linking = setTimeout(() => {
        const { kind } = this.state, names = KINDS[kind].sliders.concat(kind === "own" ? [] : ["preindent_um"]);
        if (kind === "noise") names.push("seed");
        const parts = names.map((name) => name + "=" + this.state[name]);
        history.replaceState(null, "", "#" + ["kind=" + kind].concat(parts).join("&"));
      }, 300);
    }
  }

  function round2(value) {
    return Number(value.toPrecision(2));
  }

  function start() {
    const places = document.querySelectorAll(".fembridge-playground");
    const made = Array.from(places, (element) => new Playground(element));
    window.fembridgePlayground = { all: made, loading, waveform, rateIps, encode: (d) => encoder(d) };
  }
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();

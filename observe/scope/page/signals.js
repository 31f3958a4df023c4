// Plots of signals.

import { $, make, put, number, span, instant, step } from "./text.js";
import { colours, colourOf, fit, Painter } from "./draw.js";
import { gestures } from "./gestures.js";
import { Columns } from "./series.js";
import { Cursors } from "./cursors.js";
import { exportCsv, exportPng } from "./export.js";

const LEFT = 62, RIGHT = 14, TOP = 10, BOTTOM = 26; // of the plot, in CSS pixels
const SHORTEST = 20e-6, LONGEST = 120;
const CHOSEN_AT_FIRST = 6;
const BEFORE_TRIGGER = 0.25; // of the plot

export class Signals {
  constructor(model, clock) {
    Object.assign(this, { model, clock });
    this.root = $("#signals");
    this.list = $("#signal-list");
    [this.under, this.traces, this.over] = this.root.querySelectorAll(".plot canvas");
    this.empty = $(".empty", this.root);
    this.painter = new Painter();
    this.layout = "stack";
    this.span = 10;
    this.end = null; // of the plot, while it does not follow
    this.chosen = new Set();
    this.rows = new Map();
    this.version = -1;
    this.trigger = { on: false, signal: null, edge: 1, level: 0, single: false, at: null, armed: -Infinity };
    this.cursors = new Cursors(this);
    this.controls();
    this.clock.listeners.add(() => { this.end = this.clock.live ? null : this.to ?? this.clock.now; });
  }

  controls() {
    for (const button of this.root.querySelectorAll("[data-layout]")) {
      button.onclick = () => {
        this.layout = button.dataset.layout;
        for (const other of this.root.querySelectorAll("[data-layout]")) other.setAttribute("aria-pressed", other === button);
      };
    }
    $("#zoom-in").onclick = () => this.zoom(0.5);
    $("#zoom-out").onclick = () => this.zoom(2);
    $("#cursors").onclick = () => this.cursors.toggle();
    $("#export-csv").onclick = () => exportCsv(this);
    $("#export-png").onclick = () => exportPng(this);
    $("#signal-filter").oninput = () => this.filter();
    $("#signals-all").onclick = () => this.all();
    $("#trigger").onclick = () => this.toggleTrigger();
    $("#trigger-signal").onchange = (event) => { this.trigger.signal = event.target.value; this.middle(); };
    $("#trigger-edge").onchange = (event) => this.rearm({ edge: Number(event.target.value) });
    $("#trigger-level").onchange = (event) => this.rearm({ level: Number(event.target.value) });
    $("#trigger-mode").onchange = (event) => this.rearm({ single: event.target.value === "single" });
    gestures(this.over, {
      pan: (pixels) => this.pan(pixels),
      zoom: (factor, x) => this.zoom(factor, x),
      grab: (x, y) => this.cursors.grab(x) ?? this.grabLevel(x, y),
      tap: (x) => this.cursors.tap(x),
      home: () => this.clock.follow(),
    });
    this.over.addEventListener("pointermove", (event) => {
      const box = this.over.getBoundingClientRect();
      this.pointer = event.clientX - box.left;
      this.over.style.cursor = this.cursors.near(this.pointer) ? "ew-resize" : "crosshair";
    });
    this.over.addEventListener("pointerleave", () => { this.pointer = null; });
  }

  // Keys that work wherever the focus is.
  key(key) {
    if (key === "c") this.cursors.toggle();
    else if (key === "t") this.toggleTrigger();
    else return false;
    return true;
  }

  // What is plotted: { key, name, signal, element, colour }.
  get curves() {
    const curves = [];
    for (const { signal, element, key, name, place } of this.rows.values()) {
      if (this.chosen.has(key)) curves.push({ signal, element, key, name, colour: colourOf(place) });
    }
    return curves;
  }

  declare() {
    this.version = this.model.version;
    const before = this.rows;
    this.rows = new Map();
    for (const signal of [...this.model.signals.values()].sort((a, b) => a.number - b.number)) {
      for (let element = 0; element < signal.elements; element++) {
        const name = signal.elements > 1 ? `${signal.name}[${element}]` : signal.name;
        const key = name;
        const place = this.rows.size;
        const row = before.get(key) ?? this.row(key, name);
        Object.assign(row, { signal, element, place, key, name });
        row.item.title = [name, signal.unit && `in ${signal.unit}`, signal.description].filter(Boolean).join(", ");
        this.rows.set(key, row);
        if (this.chosenByHand !== true && this.chosen.size < CHOSEN_AT_FIRST) this.chosen.add(key);
      }
    }
    this.list.replaceChildren(...[...this.rows.values()].map((row) => row.item));
    const options = [...this.rows.keys()].map((key) => make("option", { value: key }, key));
    const select = $("#trigger-signal");
    select.replaceChildren(...options);
    if (this.trigger.signal) select.value = this.trigger.signal;
    this.paintRows();
    this.filter();
  }

  row(key, name) {
    const box = make("input", { type: "checkbox" });
    const swatch = make("span", { class: "swatch" });
    const value = make("span", { class: "value" });
    const figure = document.createTextNode(""), unit = make("small");
    value.append(figure, unit);
    const item = make("li", {}, make("label", {}, box, swatch, make("span", { class: "name" }, name), value));
    box.onchange = () => {
      this.chosenByHand = true;
      this.chosen[box.checked ? "add" : "delete"](key);
      this.paintRows();
    };
    return { item, box, swatch, figure, unit };
  }

  paintRows() {
    for (const { key, box, swatch, unit, signal, place } of this.rows.values()) {
      box.checked = this.chosen.has(key);
      swatch.style.background = swatch.style.borderColor = box.checked ? colourOf(place) : "";
      put(unit, signal.unit);
    }
  }

  filter() {
    const wanted = $("#signal-filter").value.toLowerCase();
    for (const { item, name } of this.rows.values()) item.hidden = !name.toLowerCase().includes(wanted);
  }

  all() {
    this.chosenByHand = true;
    const found = [...this.rows.values()].filter(({ item }) => !item.hidden).map(({ key }) => key);
    const add = found.some((key) => !this.chosen.has(key));
    for (const key of found) this.chosen[add ? "add" : "delete"](key);
    this.paintRows();
  }

  // The plot's instants.
  window() {
    const { trigger } = this;
    let to = this.end ?? this.clock.now;
    if (this.clock.live && trigger.on && trigger.at !== null) to = trigger.at + (1 - BEFORE_TRIGGER) * this.span;
    if (!this.clock.live && this.clock.speed > 0) this.end = to = this.clock.now;
    this.to = to;
    return [to - this.span, to];
  }

  get plotWidth() { return Math.max(1, this.over.clientWidth - LEFT - RIGHT); }
  x(time) { return LEFT + ((time - this.to) / this.span + 1) * this.plotWidth; }
  time(x) { return this.to - this.span + ((x - LEFT) / this.plotWidth) * this.span; }

  pan(pixels) {
    if (this.clock.live) this.clock.pause();
    this.end = (this.end ?? this.clock.now) - (pixels / this.plotWidth) * this.span;
    this.end = Math.min(this.end, this.clock.latest + this.span / 2);
    this.clock.now = Math.min(this.end, this.clock.latest);
  }

  zoom(factor, x) {
    const before = this.span;
    this.span = Math.min(LONGEST, Math.max(SHORTEST, this.span * factor));
    if (this.end === null || x === undefined) return;
    const share = 1 - (x - LEFT) / this.plotWidth;
    this.end += share * (this.span - before);
  }

  toggleTrigger() {
    const { trigger } = this;
    trigger.on = !trigger.on;
    $("#trigger").setAttribute("aria-pressed", trigger.on);
    $("#trigger-settings").hidden = !trigger.on;
    if (!trigger.on) return;
    if (!this.rows.has(trigger.signal)) {
      trigger.signal = this.curves[0]?.key ?? null;
      $("#trigger-signal").value = trigger.signal;
      this.middle();
    } else this.rearm({});
  }

  // A level that the signal crosses: halfway between its least and greatest value.
  middle() {
    const row = this.rows.get(this.trigger.signal);
    if (!row || !row.signal.series) return;
    const { series } = row.signal;
    const one = new Float64Array(1), other = new Float64Array(1);
    const [low, high] = series.columns(row.element, this.clock.latest - Math.max(1, this.span), this.clock.latest, 1, one, other);
    const level = isFinite(low) ? Number(((low + high) / 2).toPrecision(4)) : 0;
    $("#trigger-level").value = level;
    this.rearm({ level });
  }

  rearm(changes) {
    Object.assign(this.trigger, changes, { at: null, armed: this.clock.live ? this.clock.now : -Infinity });
    if (!this.clock.live && this.trigger.single) this.clock.follow();
  }

  // Searches new samples for crossings, and holds the plot at the last one that is complete.
  look() {
    const { trigger, clock } = this;
    const row = trigger.on && clock.live && this.rows.get(trigger.signal);
    if (!row) return;
    const { series } = row.signal;
    const after = (1 - BEFORE_TRIGGER) * this.span;
    for (let turns = 0; turns < 64; turns++) {
      const at = series.crossing(row.element, trigger.level, trigger.edge, trigger.armed);
      if (at === null) {
        // What was looked at need not be looked at again.
        if (series.end > series.begin) trigger.armed = Math.max(trigger.armed, series.lastTime - 1e-9);
        break;
      }
      if (at + after > clock.latest) break;
      trigger.at = at;
      trigger.count = (trigger.count ?? 0) + 1;
      trigger.armed = at + after;
      if (trigger.single) {
        this.to = at + after;
        clock.pause(Math.min(clock.latest, this.to));
        break;
      }
    }
    put($("#trigger-state"), trigger.at === null ? "waits for the level" : `at ${instant(trigger.at, 1e-4)}`);
  }

  grabLevel(x, y) {
    if (!this.trigger.on || !this.levelY || Math.abs(y - this.levelY) > 9 || x < LEFT) return null;
    const { scale } = this.levelLane;
    return { drag: (_, y) => {
      const level = Number((scale.high - ((y - scale.top) / (scale.bottom - scale.top)) * (scale.high - scale.low)).toPrecision(4));
      $("#trigger-level").value = level;
      this.rearm({ level });
    } };
  }

  frame() {
    if (this.version !== this.model.version) this.declare();
    this.look();
    const curves = this.curves;
    const note = this.rows.size === 0 ? "No signals yet. A process records them with Signal::record." : curves.length === 0 ? "Choose signals in the list." : "";
    put(this.empty, note);
    this.empty.hidden = note === "";
    put($("#span"), span(this.span));
    const under = fit(this.under), traces = fit(this.traces), over = fit(this.over);
    if (under.width < LEFT + RIGHT + 20) return;
    // By whole columns, so that those of the frame before can be used again.
    const columns = Math.max(1, Math.round((traces.width - LEFT - RIGHT) * traces.ratio)), perSecond = columns / this.span;
    const start = Math.floor(this.window()[0] * perSecond + 1e-6);
    const from = start / perSecond, to = from + this.span;
    this.to = to;
    const palette = colours();
    this.scales(curves, start, perSecond, columns, traces);
    this.drawUnder(under, palette, curves, from, to);
    this.drawTraces(traces, curves);
    this.drawOver(over, palette, curves);
    this.values(curves);
  }

  // Columns of all curves, and their lanes, each with its own scale or one for all.
  scales(curves, start, perSecond, columns, { height }) {
    const bottom = height - BOTTOM;
    const lanes = this.layout === "stack" ? Math.max(1, curves.length) : 1;
    const high = (bottom - TOP) / lanes;
    this.lanes = [];
    curves.forEach((curve, n) => {
      const row = this.rows.get(curve.key);
      row.columns ??= new Columns();
      const [low, most] = row.columns.update(curve.signal.series, curve.element, start, perSecond, columns);
      let lane = this.lanes[this.layout === "stack" ? n : 0];
      if (!lane) {
        const top = TOP + this.lanes.length * high;
        lane = { curves: [], low: Infinity, high: -Infinity, top, bottom: top + high };
        this.lanes.push(lane);
      }
      lane.curves.push({ ...curve, row });
      lane.low = Math.min(lane.low, low);
      lane.high = Math.max(lane.high, most);
    });
    for (const lane of this.lanes) {
      const key = lane.curves.map((curve) => curve.key).join();
      lane.scale = this.ease(key, lane);
      const high = lane.bottom - lane.top, pad = Math.min(12, high * 0.14);
      // Room for the names, where there is any.
      lane.scale.top = lane.top + (high >= 56 ? 26 : pad);
      lane.scale.bottom = lane.bottom - pad;
    }
    for (const key of this.eased.keys()) if (!this.lanes.some((lane) => lane.scale === this.eased.get(key))) this.eased.delete(key);
  }

  eased = new Map();

  // A scale grows at once and shrinks slowly, so that it does not tremble.
  ease(key, { low, high }) {
    let scale = this.eased.get(key);
    if (!isFinite(low) || !isFinite(high)) return scale ?? { low: 0, high: 1 };
    const margin = high > low ? 0 : Math.max(Math.abs(high) * 0.1, 1e-9);
    low -= margin;
    high += margin;
    if (!scale) this.eased.set(key, (scale = { low, high }));
    scale.low = low < scale.low ? low : scale.low + (low - scale.low) * 0.06;
    scale.high = high > scale.high ? high : scale.high + (high - scale.high) * 0.06;
    return scale;
  }

  drawUnder({ context, width, height }, palette, curves, from, to) {
    context.clearRect(0, 0, width, height);
    context.font = "12px ui-sans-serif, system-ui, sans-serif";
    const bottom = height - BOTTOM, every = step(from, to, Math.max(2, this.plotWidth / 110));
    context.textBaseline = "middle";
    context.textAlign = "center";
    const grid = palette.grid, line = palette.line, muted = palette.muted, faint = palette.faint, words = palette.text;
    context.fillStyle = grid;
    for (let n = Math.ceil(from / every); n * every <= to; n++) context.fillRect(Math.round(this.x(n * every)), TOP, 1, bottom - TOP);
    context.fillStyle = muted;
    for (let n = Math.ceil(from / every); n * every <= to; n++) {
      const x = this.x(n * every);
      if (x > LEFT + 22 && x < width - RIGHT - 22) context.fillText(instant(n * every, every), x, height - BOTTOM / 2);
    }
    this.lanes.forEach((lane, n) => {
      const { scale } = lane, high = lane.bottom - lane.top;
      if (n > 0) { context.fillStyle = line; context.fillRect(LEFT, Math.round(lane.top), width - LEFT - RIGHT, 1); }
      const lines = Math.floor((scale.bottom - scale.top) / 16);
      const y = (value) => scale.bottom - ((value - scale.low) / (scale.high - scale.low)) * (scale.bottom - scale.top);
      context.textAlign = "right";
      if (lines >= 1 && scale.high > scale.low) {
        const each = step(scale.low, scale.high, lines);
        for (let m = Math.ceil(scale.low / each); m * each <= scale.high; m++) {
          context.fillStyle = grid;
          context.fillRect(LEFT, Math.round(y(m * each)), width - LEFT - RIGHT, 1);
          context.fillStyle = faint;
          context.fillText(number(m * each), LEFT - 9, y(m * each));
        }
      } else {
        context.fillStyle = faint;
        context.fillText(number(Number(scale.high.toPrecision(3))), LEFT - 9, (lane.top + lane.bottom) / 2);
      }
    });
  }

  drawTraces({ context, ratio }, curves) {
    const { painter } = this;
    painter.resize(context.canvas.width, context.canvas.height);
    painter.clear();
    const thick = curves.length > 16 ? 1.1 : 1.5;
    for (const lane of this.lanes) {
      const { scale } = lane;
      for (const { row, colour } of lane.curves) {
        painter.curve(row.columns.least, row.columns.most, row.columns.least.length, Math.round(LEFT * ratio), scale.low, scale.high, scale.top * ratio, scale.bottom * ratio, Painter.colour(colour), thick * ratio);
      }
    }
    painter.show(context);
  }

  drawOver({ context, width, height }, palette, curves) {
    context.clearRect(0, 0, width, height);
    context.font = "12.5px ui-sans-serif, system-ui, sans-serif";
    context.textBaseline = "middle";
    context.textAlign = "left";
    // Names stand on their curves' lanes.
    const surface = palette.surface;
    for (const lane of this.lanes) {
      let x = LEFT + 10;
      for (const { name, colour, signal } of lane.curves) {
        const text = signal.unit ? `${name}  ${signal.unit}` : name;
        const wide = context.measureText(text).width;
        if (x > LEFT + 10 && x + wide > width - RIGHT) break;
        const y = lane.bottom - lane.top < 34 ? lane.top + (lane.bottom - lane.top) / 2 : lane.top + 13;
        context.globalAlpha = 0.82;
        context.fillStyle = surface;
        context.beginPath();
        context.roundRect(x - 5, y - 9, wide + 10, 18, 5);
        context.fill();
        context.globalAlpha = 1;
        context.fillStyle = colour;
        context.fillText(text, x, y);
        x += wide + 22;
      }
    }
    this.drawTrigger(context, palette, width);
    this.cursors.draw(context, palette, height - BOTTOM, TOP);
  }

  drawTrigger(context, palette, width) {
    this.levelY = null;
    const { trigger } = this;
    if (!trigger.on) return;
    const lane = this.lanes.find((lane) => lane.curves.some((curve) => curve.key === trigger.signal));
    context.strokeStyle = context.fillStyle = palette.ready;
    context.setLineDash([5, 4]);
    if (lane) {
      const { scale } = lane;
      const y = scale.bottom - ((trigger.level - scale.low) / (scale.high - scale.low)) * (scale.bottom - scale.top);
      if (y >= lane.top && y <= lane.bottom) {
        this.levelY = y;
        this.levelLane = lane;
        context.beginPath();
        context.moveTo(LEFT, y);
        context.lineTo(width - RIGHT, y);
        context.stroke();
        context.beginPath();
        context.moveTo(width - RIGHT, y);
        context.lineTo(width - RIGHT + 9, y - 6);
        context.lineTo(width - RIGHT + 9, y + 6);
        context.fill();
      }
    }
    if (trigger.at !== null) {
      const x = this.x(trigger.at);
      context.beginPath();
      context.moveTo(x, TOP);
      context.lineTo(x, context.canvas.clientHeight - BOTTOM);
      context.stroke();
    }
    context.setLineDash([]);
  }

  // The list's figures: the last value, or the value at the selected instant. Updated ten times a second, to be readable.
  values() {
    const now = performance.now();
    if (now - (this.updated ?? -Infinity) < 100) return;
    this.updated = now;
    const at = this.clock.live ? Infinity : this.clock.now;
    for (const row of this.rows.values()) {
      const { signal, element, figure } = row;
      const { series } = signal;
      const value = at === Infinity ? (series.end > series.begin ? series.value(series.end - 1, element) : NaN) : series.at(at, element);
      // The number of decimals follows from the greatest value, so that the figures do not jump.
      row.peak = Math.max(row.peak ?? 0, Math.abs(value) || 0);
      const decimals = Math.max(0, Math.min(4, 3 - Math.floor(Math.log10(row.peak || 1))));
      const text = Number.isFinite(value) && row.peak < 1e7 && row.peak >= 1e-3 && !Number.isInteger(row.peak) ? value.toFixed(decimals).replace("-", "−") : number(value);
      if (figure.data !== text) figure.data = text;
    }
    this.cursors.table();
  }
}

// Plots of signals.

import { $, make, put, multiples, number, span, instant, step } from "./text.js";
import { AXIS, BOTTOM, RIGHT, TOP, colours, fit, label, Painter } from "./draw.js";
import { gestures } from "./gestures.js";
import { Columns } from "./series.js";
import { Cursors } from "./cursors.js";
import { List } from "./list.js";
import { MarkStrip } from "./marks.js";
import { Readings } from "./readings.js";
import { Trigger } from "./trigger.js";
import { Whole } from "./whole.js";
import { XY } from "./xy.js";
import { exportCsv, exportPng } from "./export.js";

const SHORTEST = 20e-6, LONGEST = 1e7;
const FOLLOWED = 10; // seconds of a run that are shown while it goes on

// The range of an axis is wider than this: its ends differ by far more than the rounding of a number.
const narrowest = (low, high) => Math.max(Math.abs(low), Math.abs(high)) * 1e-12;

// A name with room beside an axis.
const brief = (name) => (name.length > 8 ? `${name.slice(0, 7)}…` : name);

export class Signals {
  constructor(model, clock) {
    Object.assign(this, { model, clock });
    this.root = $("#signals");
    this.list = new List(model, clock);
    [this.under, this.traces, this.over] = this.root.querySelectorAll(".plot canvas");
    this.empty = $(".empty", this.root);
    this.painter = new Painter();
    this.layout = "stack";
    this.chosenSpan = null; // until then the plot fits the run
    this.end = null; // of the plot, while it does not follow
    this.trigger = new Trigger(this);
    this.cursors = new Cursors(this);
    this.readings = new Readings(this);
    this.marks = new MarkStrip(this);
    this.xy = new XY(this);
    this.whole = new Whole(this);
    this.controls();
    this.clock.listeners.add(() => { this.end = this.clock.live ? null : this.to ?? this.clock.now; });
  }

  get rows() { return this.list.rows; }
  get chosen() { return this.list.chosen; }
  get curves() { return this.list.curves; }
  get shown() { return this.layout === "xy" ? this.xy.curves : this.curves; }

  controls() {
    for (const button of this.root.querySelectorAll("[data-layout]")) button.onclick = () => this.lay(button.dataset.layout);
    $("#zoom-in").onclick = () => this.zoom(0.5);
    $("#zoom-out").onclick = () => this.zoom(2);
    $("#fit-y").onclick = () => this.held.clear();
    $("#fit").onclick = () => this.showAll();
    $("#cursors").onclick = () => this.cursors.toggle();
    $("#export-csv").onclick = () => exportCsv(this);
    $("#export-png").onclick = () => exportPng(this);
    gestures(this.over, {
      pan: (pixels) => this.pan(pixels),
      zoom: (factor, x, y) => {
        const lane = x < this.left && y !== undefined ? this.laneAt(x, y) : undefined;
        if (lane) this.zoomY(factor, lane, y);
        else if (y !== undefined && this.xy.isOn(x, y)) this.xy.zoom(factor, x);
        else this.zoom(factor, x);
      },
      grab: (x, y) => this.grabAxis(x, y) ?? this.xy.grab(x, y) ?? (this.layout === "xy" ? null : this.cursors.grab(x) ?? this.trigger.grab(x, y)),
      tap: (x, y) => this.layout !== "xy" && (this.marks.tap(x, y) || this.cursors.tap(x)),
      home: () => this.clock.follow(),
    });
    this.over.addEventListener("pointermove", (event) => {
      const box = this.over.getBoundingClientRect();
      const [x, y] = (this.pointer = [event.clientX - box.left, event.clientY - box.top]);
      const isMark = this.layout !== "xy" && this.marks.isOn(y) && this.marks.at(x).length > 0;
      this.over.style.cursor = x < this.left ? "ns-resize" : this.xy.isOn(x, y) ? "ew-resize" : isMark ? "pointer" : this.layout !== "xy" && this.cursors.near(x) ? "ew-resize" : "crosshair";
    });
    this.over.addEventListener("pointerleave", () => { this.pointer = null; });
  }

  // Stacked lanes ("stack"), all curves in one place ("overlay"), or one signal over another ("xy").
  lay(layout) {
    this.layout = layout;
    for (const button of this.root.querySelectorAll("[data-layout]")) button.setAttribute("aria-pressed", button.dataset.layout === layout);
    $("#xy-settings").hidden = layout !== "xy";
    this.traces.getContext("2d").clearRect(0, 0, this.traces.width, this.traces.height);
    if (layout === "xy") this.xy.begin();
  }

  // Keys that work wherever the focus is.
  key(key) {
    if (key === "c") this.cursors.toggle();
    else if (key === "t") this.trigger.toggle();
    else if (key === "s") this.readings.toggle();
    else if (key === "f") this.showAll();
    else if (key === "y") this.held.clear();
    else if (key === "n" || key === "p") this.marks.go(key === "n" ? 1 : -1);
    else if (key === "[" || key === "]") for (const lane of this.lanes) this.zoomY(key === "]" ? 0.7 : 1 / 0.7, lane);
    else return false;
    return true;
  }

  // What the plot shows of time: all of a file, or of a run that has ended, and the last seconds of one that goes on, unless another span was chosen.
  get span() {
    const { ended, until, last } = this.model;
    return this.chosenSpan ?? Math.max(0.01, until > 0 || ended !== null ? last : Math.min(FOLLOWED, this.clock.now));
  }
  set span(span) { this.chosenSpan = span; }

  // The plot's instants. Nothing lies before the first.
  window() {
    let to = this.end ?? this.clock.now;
    if (this.clock.live) to = this.trigger.end ?? to;
    if (!this.clock.live && this.clock.speed > 0) this.end = to = this.clock.now;
    this.to = to = Math.max(to, this.span);
    return [to - this.span, to];
  }

  get plotWidth() { return Math.max(1, this.over.clientWidth - this.left - RIGHT); }
  x(time) { return this.left + ((time - this.to) / this.span + 1) * this.plotWidth; }
  time(x) { return this.to - this.span + ((x - this.left) / this.plotWidth) * this.span; }

  pan(pixels) {
    if (this.clock.live) this.clock.pause();
    this.end = (this.end ?? this.clock.now) - (pixels / this.plotWidth) * this.span;
    this.end = Math.min(this.end, this.model.last + this.span / 2);
    this.clock.now = Math.min(this.end, this.clock.latest);
  }

  spread(span) { this.span = Math.min(LONGEST, Math.max(SHORTEST, span)); }

  zoom(factor, x) {
    const before = this.span;
    this.spread(this.span * factor);
    if (this.end === null || x === undefined) return;
    const share = 1 - (x - this.left) / this.plotWidth;
    this.end += share * (this.span - before);
  }

  // From the start of the run to its last instant.
  showAll() {
    const { last } = this.model;
    this.span = Math.max(0.01, last);
    if (last > this.clock.latest && this.clock.live) this.clock.pause();
    if (!this.clock.live) this.end = last;
  }

  // Stands still with an instant in the middle.
  showAt(time) {
    if (this.clock.live) this.clock.pause();
    this.chosenSpan ??= Math.min(FOLLOWED, this.span); // a part, if the plot has shown all
    this.end = Math.min(this.model.last + this.span / 2, Math.max(0, time) + this.span / 2);
    this.clock.now = Math.min(this.end, this.clock.latest);
  }

  frame() {
    if (this.list.declare()) this.declare();
    this.trigger.look();
    const isXY = this.layout === "xy", curves = this.shown;
    const note = this.rows.size === 0 ? "No signals yet. A process records them with Signal::record." : curves.length === 0 ? "Choose signals in the list." : "";
    put(this.empty, note);
    this.empty.hidden = note === "";
    put($("#span"), span(this.span));
    const under = fit(this.under), traces = fit(this.traces), over = fit(this.over);
    // One for each unit of overlaid curves, as far as there is room.
    const units = this.layout === "overlay" ? new Set(curves.map(({ signal }) => signal.unit)).size : 1;
    this.axes = Math.max(1, Math.min(units, Math.floor(under.width / 200)));
    if (under.width < this.left + RIGHT + 20) return;
    // By whole columns, so that those of the frame before can be used again.
    const columns = Math.max(1, Math.round((traces.width - this.left - RIGHT) * traces.ratio)), perSecond = columns / this.span;
    const start = Math.floor(this.window()[0] * perSecond + 1e-6);
    const from = start / perSecond, to = from + this.span;
    this.to = to;
    const palette = colours();
    if (isXY) this.xy.frame(under, traces, palette, from, to);
    else {
      this.scales(curves, start, perSecond, columns, traces);
      this.drawUnder(under, palette, from, to);
      this.drawTraces(traces, curves);
    }
    $("#fit-y").disabled = this.held.size === 0;
    this.drawOver(over, palette);
    this.whole.draw(isXY ? this.curves : curves, palette, from, to);
    const now = performance.now();
    // Ten times a second, to be readable.
    if (now - (this.updated ?? -Infinity) < 100) return;
    this.updated = now;
    this.list.values();
    this.readings.show();
  }

  declare() {
    const keys = [...this.rows.keys()];
    const select = $("#trigger-signal");
    select.replaceChildren(...keys.map((key) => make("option", { value: key }, key)));
    if (this.trigger.signal) select.value = this.trigger.signal;
    this.xy.declare(keys);
    if (this.layout === "xy") this.xy.begin();
  }

  // Where the plot begins: beside its axes.
  get left() { return AXIS * this.axes; }

  // Columns of all curves, and their lanes, each with its own scale. Overlaid curves share the lane of their unit, and all lanes one place.
  scales(curves, start, perSecond, columns, { height }) {
    const bottom = height - BOTTOM;
    const isStack = this.layout === "stack";
    const high = (bottom - TOP) / (isStack ? Math.max(1, curves.length) : 1);
    this.lanes = [];
    curves.forEach((curve) => {
      const row = this.rows.get(curve.key);
      row.columns ??= new Columns();
      const range = row.columns.update(curve.signal.series, curve.element, start, perSecond, columns).map((value) => value * row.gain + row.offset);
      const { unit } = curve.signal;
      let lane = isStack ? undefined : this.lanes.find((lane) => lane.unit === unit);
      if (!lane) {
        const top = TOP + (isStack ? this.lanes.length * high : 0);
        lane = { unit, axis: isStack ? 0 : this.lanes.length, curves: [], low: Infinity, high: -Infinity, top, bottom: top + high };
        this.lanes.push(lane);
      }
      lane.curves.push({ ...curve, row });
      lane.low = Math.min(lane.low, ...range);
      lane.high = Math.max(lane.high, ...range);
    });
    for (const lane of this.lanes) {
      lane.key = lane.curves.map((curve) => curve.key).join();
      lane.scale = this.held.get(lane.key) ?? this.ease(lane.key, lane);
      const high = lane.bottom - lane.top, pad = Math.min(12, high * 0.14);
      // Room for the names, where there is any.
      lane.scale.top = lane.top + (high >= 56 ? 26 : pad);
      lane.scale.bottom = lane.bottom - pad;
    }
    for (const key of this.eased.keys()) if (!this.lanes.some((lane) => lane.scale === this.eased.get(key))) this.eased.delete(key);
  }

  axes = 1;
  eased = new Map();
  held = new Map(); // scales that were zoomed or moved by hand

  // The lane at a place, and there by its axis.
  laneAt(x, y) {
    const there = this.lanes.filter((lane) => y >= lane.top && y < lane.bottom);
    return there.find((lane) => x >= this.left - (lane.axis + 1) * AXIS && x < this.left - lane.axis * AXIS) ?? there[0];
  }

  // Sets an axis by hand, unless its range would be too narrow.
  hold(key, low, high, place) { if (high - low > narrowest(low, high)) this.held.set(key, { low, high, ...place }); }

  // Zooms a lane's axis around a place on it.
  zoomY(factor, lane, y = (lane.top + lane.bottom) / 2) {
    const { low, high, top, bottom } = lane.scale;
    const middle = high - ((y - top) / (bottom - top)) * (high - low);
    this.hold(lane.key, middle - (middle - low) * factor, middle + (high - middle) * factor, { top, bottom });
  }

  // An axis is dragged.
  grabAxis(x, y) {
    const lane = x < this.left ? this.laneAt(x, y) : undefined;
    if (!lane) return null;
    const { low, high, top, bottom } = lane.scale;
    return { drag: (_, now) => {
      const by = ((now - y) / (bottom - top)) * (high - low);
      this.hold(lane.key, low + by, high + by, { top, bottom });
    } };
  }

  // Values that get a label: round ones, if two of them have room, else the ends. `apart`: pixels from one to the next.
  ticks({ low, high, top, bottom }, apart = 40) {
    for (const room of [apart, 16, 11]) {
      const all = multiples(step(low, high, Math.max(1, (bottom - top) / room)), low, high);
      if (all.length > 1) return all;
    }
    const digits = Math.min(15, Math.max(0, 1 - Math.floor(Math.log10(high - low))));
    return [low, high].map((value) => Number(value.toFixed(digits)));
  }

  // The names of an axis: those of the one curve whose values have names, where they have room.
  namesOf({ curves: [{ signal, row }, ...more], scale }) {
    if (!signal.names || more.length > 0 || row.gain !== 1 || row.offset !== 0) return null;
    const names = new Map([...signal.names].filter(([value]) => value >= scale.low && value <= scale.high));
    return names.size > 0 && names.size * 11 < scale.bottom - scale.top ? names : null;
  }

  // A scale grows at once and shrinks slowly, so that it does not tremble.
  ease(key, { low, high }) {
    let scale = this.eased.get(key);
    if (!isFinite(low) || !isFinite(high)) return scale ?? { low: 0, high: 1 };
    const margin = high - low > narrowest(low, high) ? 0 : Math.abs(high) * 0.1 || 1;
    low -= margin;
    high += margin;
    if (!scale) this.eased.set(key, (scale = { low, high }));
    scale.low = low < scale.low ? low : scale.low + (low - scale.low) * 0.06;
    scale.high = high > scale.high ? high : scale.high + (high - scale.high) * 0.06;
    return scale;
  }

  drawUnder({ context, width, height }, palette, from, to) {
    context.clearRect(0, 0, width, height);
    context.font = "12px ui-sans-serif, system-ui, sans-serif";
    const bottom = height - BOTTOM, every = step(from, to, Math.max(2, this.plotWidth / 110));
    context.textBaseline = "middle";
    context.textAlign = "center";
    const grid = palette.grid, line = palette.line, muted = palette.muted, faint = palette.faint;
    context.fillStyle = grid;
    const times = multiples(every, from, to);
    for (const time of times) context.fillRect(Math.round(this.x(time)), TOP, 1, bottom - TOP);
    context.fillStyle = muted;
    for (const time of times) {
      const x = this.x(time);
      if (x > this.left + 22 && x < width - RIGHT - 22) context.fillText(instant(time, every), x, height - 13);
    }
    for (const lane of this.lanes) {
      const { scale, axis } = lane, isLow = scale.bottom - scale.top < 20;
      if (axis === 0 && lane.top > TOP) { context.fillStyle = line; context.fillRect(this.left, Math.round(lane.top), width - this.left - RIGHT, 1); }
      context.textAlign = "right";
      const x = this.left - 9 - axis * AXIS;
      const names = this.namesOf(lane);
      lane.labels = names ? [...names.keys()] : this.ticks(scale);
      if (axis >= this.axes) continue;
      if (this.axes > 1) {
        context.fillStyle = lane.curves.length === 1 ? lane.curves[0].colour : muted;
        context.fillText(lane.unit || "–", x, lane.top + 13);
      }
      if (isLow) context.font = "8px ui-sans-serif, system-ui, sans-serif";
      lane.labels.forEach((value, n) => {
        const y = scale.bottom - ((value - scale.low) / (scale.high - scale.low)) * (scale.bottom - scale.top);
        context.fillStyle = grid;
        if (axis === 0 && !isLow) context.fillRect(this.left, Math.round(y), width - this.left - RIGHT, 1);
        context.fillStyle = lane.curves.length === 1 && this.axes > 1 ? lane.curves[0].colour : faint;
        context.fillText(names ? brief(names.get(value)) : label(value), x, isLow ? (n === 0 ? lane.bottom - 4 : lane.top + 4) : y);
      });
      context.font = "12px ui-sans-serif, system-ui, sans-serif";
    }
  }

  drawTraces({ context, ratio }, curves) {
    const { painter } = this;
    painter.resize(context.canvas.width, context.canvas.height);
    painter.clear();
    const thick = curves.length > 16 ? 1.1 : 1.5;
    for (const lane of this.lanes) {
      const { scale } = lane;
      for (const { row, colour } of lane.curves) {
        const { least, most } = row.columns;
        painter.curve(least, most, least.length, Math.round(this.left * ratio), (scale.low - row.offset) / row.gain, (scale.high - row.offset) / row.gain, scale.top * ratio, scale.bottom * ratio, Painter.colour(colour), thick * ratio);
      }
    }
    painter.show(context);
  }

  drawOver({ context, width, height }, palette) {
    context.clearRect(0, 0, width, height);
    context.font = "12.5px ui-sans-serif, system-ui, sans-serif";
    context.textBaseline = "middle";
    context.textAlign = "left";
    if (this.layout === "xy") {
      this.marks.tip.hidden = true;
      return this.xy.over(context, palette);
    }
    // Names stand on their curves' lanes.
    const surface = palette.surface;
    let x = this.left + 10;
    for (const lane of this.lanes) {
      if (lane.axis === 0) x = this.left + 10;
      for (const { name, colour, signal, row: { gain, offset } } of lane.curves) {
        const changed = `${gain === 1 ? "" : `  × ${number(gain)}`}${offset === 0 ? "" : `  + ${number(offset)}`}`;
        const text = `${name}${signal.unit && `  ${signal.unit}`}${changed}`;
        const wide = context.measureText(text).width;
        if (x > this.left + 10 && x + wide > width - RIGHT) break;
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
    this.trigger.draw(context, palette, width, height);
    this.cursors.draw(context, palette, height - BOTTOM, TOP);
    this.marks.draw(context, palette, height, this.pointer);
  }
}

// One signal over another, for the span of time that the plot shows.

import { $, make } from "./text.js";
import { AXIS, BOTTOM, RIGHT, TOP, label } from "./draw.js";

const MOST = 16_384; // points
const FADE = 4; // older parts are paler, so that the direction is seen

export class XY {
  constructor(signals) {
    this.signals = signals;
    this.keys = [null, null]; // of X and Y
    this.selects = [$("#xy-x"), $("#xy-y")];
    this.selects.forEach((select, n) => { select.onchange = () => { this.keys[n] = select.value; }; });
  }

  declare(options) {
    this.selects.forEach((select, n) => {
      select.replaceChildren(...options.map((key) => make("option", { value: key }, key)));
      if (this.keys[n] !== null) select.value = this.keys[n];
    });
  }

  // Shows the first two of the plot, if nothing else was chosen.
  begin() {
    const { signals } = this, keys = [...signals.curves.map(({ key }) => key), ...signals.rows.keys()];
    this.keys = this.keys.map((key, n) => key ?? keys[n] ?? null);
    this.selects.forEach((select, n) => { if (this.keys[n] !== null) select.value = this.keys[n]; });
  }

  // Those of X and Y, once both are declared.
  get curves() {
    const rows = this.keys.map((key) => this.signals.rows.get(key));
    return rows.every(Boolean) ? rows.map((row) => ({ ...this.signals.list.curve(row), row })) : [];
  }

  // Its two lanes: Y has the place of a lane of the plot, X is below.
  frame({ context, width, height }, traces, palette, from, to) {
    const { signals } = this, curves = this.curves;
    context.clearRect(0, 0, width, height);
    traces.context.clearRect(0, 0, width, height);
    signals.lanes = [];
    this.points = null;
    if (curves.length === 0) return;
    const [x, y] = curves;
    const points = (this.points = this.walk(x, y, from, to));
    const bottom = height - BOTTOM, right = width - RIGHT;
    const lane = (curve, name, range, begin, end) => {
      const lane = { key: `${name} ${curve.key}`, unit: curve.signal.unit, axis: 0, curves: [curve], low: range[0], high: range[1], top: TOP, bottom };
      lane.scale = signals.held.get(lane.key) ?? signals.ease(lane.key, lane);
      Object.assign(lane.scale, { top: begin, bottom: end });
      return lane;
    };
    this.lane = lane(x, "x", points.rangeX, signals.left + 12, right - 12);
    signals.lanes = [lane(y, "y", points.rangeY, TOP + 26, bottom - 12)];
    this.axes(context, palette, width, height);
    this.trail(traces.context, palette, y.colour);
  }

  place(scale, value) { return (value - scale.low) / (scale.high - scale.low); }
  screenX(value) { const { scale } = this.lane; return scale.top + this.place(scale, value) * (scale.bottom - scale.top); }
  screenY(value) { const { scale } = this.signals.lanes[0]; return scale.bottom - this.place(scale, value) * (scale.bottom - scale.top); }

  // Pairs of values: for each sample of X the value that Y had then.
  walk(x, y, from, to) {
    const first = x.signal.series, second = y.signal.series;
    const begin = first.find(from), end = first.find(to);
    // The same samples from one frame to the next, so that the curve does not tremble.
    const stride = 2 ** Math.max(0, Math.ceil(Math.log2((end - begin) / MOST)));
    const xs = [], ys = [];
    const rangeX = [Infinity, -Infinity], rangeY = [Infinity, -Infinity];
    let other = second.find(from);
    for (let index = Math.ceil(begin / stride) * stride; index < end; index += stride) {
      const time = first.time(index);
      while (other < second.end && second.time(other) <= time) other++;
      if (other === second.begin) continue;
      const a = first.value(index, x.element) * x.row.gain + x.row.offset, b = second.value(other - 1, y.element) * y.row.gain + y.row.offset;
      xs.push(a);
      ys.push(b);
      if (a < rangeX[0]) rangeX[0] = a;
      if (a > rangeX[1]) rangeX[1] = a;
      if (b < rangeY[0]) rangeY[0] = b;
      if (b > rangeY[1]) rangeY[1] = b;
    }
    return { xs, ys, rangeX, rangeY };
  }

  axes(context, palette, width, height) {
    const { signals } = this, [lane] = signals.lanes, bottom = height - BOTTOM;
    context.font = "12px ui-sans-serif, system-ui, sans-serif";
    context.textBaseline = "middle";
    lane.labels = signals.ticks(lane.scale, 34);
    context.textAlign = "right";
    for (const value of lane.labels) {
      const y = this.screenY(value);
      context.fillStyle = palette.grid;
      context.fillRect(signals.left, Math.round(y), width - signals.left - RIGHT, 1);
      context.fillStyle = palette.muted;
      context.fillText(label(value), signals.left - 9, y);
    }
    this.lane.labels = signals.ticks(this.lane.scale, 90);
    context.textAlign = "center";
    for (const value of this.lane.labels) {
      const x = this.screenX(value);
      context.fillStyle = palette.grid;
      context.fillRect(Math.round(x), TOP, 1, bottom - TOP);
      context.fillStyle = palette.muted;
      context.fillText(label(value), Math.min(width - 20, x), bottom + 14);
    }
    const { name, signal } = this.lane.curves[0];
    context.fillStyle = palette.text;
    context.fillText(`${name}${signal.unit && `  ${signal.unit}`}`, (signals.left + width - RIGHT) / 2, bottom + 30);
  }

  trail(context, palette, colour) {
    const { xs, ys } = this.points, { left } = this.signals;
    context.save();
    context.beginPath();
    context.rect(left, TOP, context.canvas.clientWidth - left - RIGHT, context.canvas.clientHeight - BOTTOM - TOP);
    context.clip();
    context.strokeStyle = colour;
    context.lineWidth = 1.4;
    context.lineJoin = "round";
    for (let part = 0; part < FADE; part++) {
      const begin = Math.floor((xs.length * part) / FADE), end = Math.min(xs.length, Math.floor((xs.length * (part + 1)) / FADE) + 1);
      context.globalAlpha = (part + 1) / FADE;
      context.beginPath();
      let isDown = false, lastX = NaN, lastY = NaN;
      for (let n = begin; n < end; n++) {
        const x = this.screenX(xs[n]), y = this.screenY(ys[n]);
        if (x !== x || y !== y) { isDown = false; continue; }
        // What lies within a pixel of the last is not seen.
        if (isDown && n < end - 1 && Math.abs(x - lastX) < 0.7 && Math.abs(y - lastY) < 0.7) continue;
        if (isDown) context.lineTo(x, y); else context.moveTo(x, y);
        isDown = true;
        lastX = x;
        lastY = y;
      }
      context.stroke();
    }
    context.globalAlpha = 1;
    context.restore();
  }

  // The latest point, and where the cursors are.
  over(context, palette) {
    if (!this.points) return;
    const [x, y] = this.curves, { cursors, to, left } = this.signals;
    const at = (time) => [x, y].map(({ signal, element, row }) => signal.series.at(time, element) * row.gain + row.offset);
    const dot = ([a, b], text) => {
      const [left, top] = [this.screenX(a), this.screenY(b)];
      if (left !== left || top !== top) return;
      context.beginPath();
      context.arc(left, top, text ? 9 : 4.5, 0, 7);
      context.fill();
      if (!text) return;
      context.fillStyle = palette["on-accent"];
      context.textAlign = "center";
      context.fillText(text, left, top + 0.5);
      context.fillStyle = palette.accent;
    };
    context.fillStyle = y.colour;
    dot(at(to));
    const unit = y.signal.unit;
    context.textAlign = "left";
    context.fillText(`${y.name}${unit && `  ${unit}`}`, left + 10, TOP + 13);
    context.fillStyle = palette.accent;
    if (cursors.on) cursors.at.forEach((time, n) => dot(at(time), "AB"[n]));
  }

  // Zooms the axis of X around a place on it.
  zoom(factor, x) {
    const { low, high, top, bottom } = this.lane.scale;
    const middle = low + ((x - top) / (bottom - top)) * (high - low);
    this.signals.hold(this.lane.key, middle - (middle - low) * factor, middle + (high - middle) * factor, { top, bottom });
  }

  // The axis of X is dragged.
  grab(x, y) {
    if (!this.isOn(x, y)) return null;
    const { low, high, top, bottom } = this.lane.scale;
    return { drag: (now) => {
      const by = ((x - now) / (bottom - top)) * (high - low);
      this.signals.hold(this.lane.key, low + by, high + by, { top, bottom });
    } };
  }

  isOn(x, y) { return this.signals.layout === "xy" && this.points && x >= AXIS && y > this.signals.over.clientHeight - BOTTOM; }
}

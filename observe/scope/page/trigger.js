// The trigger: holds the plot where a signal crosses a level.

import { $, put, instant } from "./text.js";
import { RIGHT, TOP, BOTTOM } from "./draw.js";

const BEFORE = 0.25; // of the plot

export class Trigger {
  constructor(signals) {
    this.signals = signals;
    Object.assign(this, { on: false, signal: null, edge: 1, level: 0, single: false, at: null, armed: -Infinity });
    $("#trigger").onclick = () => this.toggle();
    $("#trigger-signal").onchange = (event) => { this.signal = event.target.value; this.middle(); };
    $("#trigger-edge").onchange = (event) => this.rearm({ edge: Number(event.target.value) });
    $("#trigger-level").onchange = (event) => this.rearm({ level: Number(event.target.value) });
    $("#trigger-mode").onchange = (event) => this.rearm({ single: event.target.value === "single" });
  }

  get row() { return this.signals.rows.get(this.signal); }

  toggle() {
    this.on = !this.on;
    $("#trigger").setAttribute("aria-pressed", this.on);
    $("#trigger-settings").hidden = !this.on;
    if (!this.on) return;
    if (!this.row) {
      this.signal = this.signals.curves[0]?.key ?? null;
      $("#trigger-signal").value = this.signal;
      this.middle();
    } else this.rearm({});
  }

  // A level that the signal crosses: halfway between its least and greatest value.
  middle() {
    const { row, signals: { clock, span } } = this;
    if (!row || !row.signal.series) return;
    const { series } = row.signal;
    const one = new Float64Array(1), other = new Float64Array(1);
    const [low, high] = series.columns(row.element, clock.latest - Math.max(1, span), clock.latest, 1, one, other);
    const level = isFinite(low) ? Number(((low + high) / 2).toPrecision(4)) : 0;
    $("#trigger-level").value = level;
    this.rearm({ level });
  }

  rearm(changes) {
    const { clock } = this.signals;
    Object.assign(this, changes, { at: null, armed: clock.live ? clock.now : -Infinity });
    if (!clock.live && this.single) clock.follow();
  }

  // The last instant of a plot that is held at the crossing; null if it is not.
  get end() { return this.on && this.at !== null ? this.at + (1 - BEFORE) * this.signals.span : null; }

  // Searches new samples for crossings, and holds the plot at the last one that is complete.
  look() {
    const { signals } = this, { clock } = signals;
    const row = this.on && clock.live && this.row;
    if (!row) return;
    const { series } = row.signal;
    const after = (1 - BEFORE) * signals.span;
    for (let turns = 0; turns < 64; turns++) {
      const at = series.crossing(row.element, this.level, this.edge, this.armed);
      if (at === null) {
        // What was looked at need not be looked at again.
        if (series.end > series.begin) this.armed = Math.max(this.armed, series.lastTime - 1e-9);
        break;
      }
      if (at + after > clock.latest) break;
      this.at = at;
      this.count = (this.count ?? 0) + 1;
      this.armed = at + after;
      if (this.single) {
        signals.to = at + after;
        clock.pause(Math.min(clock.latest, signals.to));
        break;
      }
    }
    put($("#trigger-state"), this.at === null ? "waits for the level" : `at ${instant(this.at, 1e-4)}`);
  }

  // The level is dragged.
  grab(x, y) {
    if (!this.on || !this.y || Math.abs(y - this.y) > 9 || x < this.signals.left) return null;
    const { scale } = this.lane;
    return { drag: (_, y) => {
      const { gain, offset } = this.row;
      const shown = scale.high - ((y - scale.top) / (scale.bottom - scale.top)) * (scale.high - scale.low);
      const level = Number(((shown - offset) / gain).toPrecision(4));
      $("#trigger-level").value = level;
      this.rearm({ level });
    } };
  }

  draw(context, palette, width, height) {
    this.y = null;
    if (!this.on) return;
    const { left, lanes } = this.signals;
    const lane = lanes.find((lane) => lane.curves.some((curve) => curve.key === this.signal));
    context.strokeStyle = context.fillStyle = palette.ready;
    context.setLineDash([5, 4]);
    if (lane) {
      const { scale } = lane;
      const { gain, offset } = this.row;
      const y = scale.bottom - ((this.level * gain + offset - scale.low) / (scale.high - scale.low)) * (scale.bottom - scale.top);
      if (y >= lane.top && y <= lane.bottom) {
        this.y = y;
        this.lane = lane;
        context.beginPath();
        context.moveTo(left, y);
        context.lineTo(width - RIGHT, y);
        context.stroke();
        context.beginPath();
        context.moveTo(width - RIGHT, y);
        context.lineTo(width - RIGHT + 9, y - 6);
        context.lineTo(width - RIGHT + 9, y + 6);
        context.fill();
      }
    }
    if (this.at !== null) {
      const x = this.signals.x(this.at);
      context.beginPath();
      context.moveTo(x, TOP);
      context.lineTo(x, height - BOTTOM);
      context.stroke();
    }
    context.setLineDash([]);
  }
}

// Two cursors, with the values at each and their differences.

import { $, make, put, number, span, instant } from "./text.js";

const NEAR = 9;

export class Cursors {
  constructor(signals) {
    this.signals = signals;
    this.on = false;
    this.at = [null, null];
    this.cells = new Map();
  }

  toggle() {
    this.on = !this.on;
    $("#cursors").setAttribute("aria-pressed", this.on);
    $("#cursor-table").hidden = !this.on;
    if (!this.on) return;
    const { signals } = this;
    // Values are read off what stands still.
    if (signals.clock.live) signals.clock.pause();
    const [from, to] = signals.window();
    this.at = [from + (to - from) * 0.4, from + (to - from) * 0.6];
    this.cells.clear();
  }

  near(x) {
    if (!this.on || x === null) return null;
    const distances = this.at.map((time) => Math.abs(this.signals.x(time) - x));
    const which = distances[0] < distances[1] ? 0 : 1;
    return distances[which] <= NEAR ? { which } : null;
  }

  grab(x) {
    const found = this.near(x);
    return found && { drag: (x) => this.move(found.which, x) };
  }

  // A tap brings the nearer one.
  tap(x) {
    if (!this.on) return;
    const [a, b] = this.at.map((time) => Math.abs(this.signals.x(time) - x));
    this.move(a < b ? 0 : 1, x);
  }

  move(which, x) {
    this.at[which] = this.signals.time(x);
    this.updated = null;
  }

  draw(context, palette, bottom, top) {
    if (!this.on) return;
    context.textAlign = "center";
    this.at.forEach((time, which) => {
      const x = Math.round(this.signals.x(time)) + 0.5;
      context.strokeStyle = context.fillStyle = palette.accent;
      context.beginPath();
      context.moveTo(x, top);
      context.lineTo(x, bottom);
      context.stroke();
      context.beginPath();
      context.roundRect(x - 10, bottom - 20, 20, 18, 5);
      context.fill();
      context.fillStyle = palette["on-accent"];
      context.fillText("AB"[which], x, bottom - 11);
    });
  }

  table() {
    if (!this.on) return;
    const { signals } = this;
    const curves = signals.curves, keys = curves.map((curve) => curve.key).join("\n");
    if (this.cells.size === 0 || this.keys !== keys) this.build(curves, keys);
    const [a, b] = this.at;
    this.cells.get("").forEach((cell, n) => put(cell, [instant(a, signals.span / 1e4), instant(b, signals.span / 1e4), `${span(b - a)}${b === a ? "" : ` · ${number(1 / Math.abs(b - a))} Hz`}`][n]));
    for (const { key, signal, element } of curves) {
      const [at, then] = [signal.series.at(a, element), signal.series.at(b, element)];
      const unit = signal.unit ? ` ${signal.unit}` : "";
      this.cells.get(key).forEach((cell, n) => put(cell, number([at, then, then - at][n]) + unit));
    }
  }

  build(curves, keys) {
    this.keys = keys;
    this.cells.clear();
    const line = (key, name) => {
      const cells = [0, 1, 2].map(() => make("td", { class: "n" }));
      this.cells.set(key, cells);
      return make("tr", {}, make("td", {}, name), ...cells);
    };
    const head = make("tr", {}, ...["", "A", "B", "B − A"].map((text, n) => make("th", { class: n ? "n" : "", scope: "col" }, text)));
    const body = make("tbody", {}, line("", "time"), ...curves.map(({ key, name }) => line(key, name)));
    $("#cursor-table").replaceChildren(make("table", {}, make("thead", {}, head), body));
  }
}

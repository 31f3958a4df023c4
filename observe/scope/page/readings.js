// The table below the plot: values at the cursors, and statistics of what the plot shows.

import { $, alike, make, put, number, span, instant } from "./text.js";

const CURSORS = ["A", "B", "B − A"], STATISTICS = ["mean", "rms", "min", "max"];

export class Readings {
  constructor(signals) {
    this.signals = signals;
    this.statistics = false;
    this.cells = new Map(); // by the name of a curve, "" for the time
    this.box = $("#readings");
    $("#statistics").onclick = () => this.toggle();
  }

  toggle(is = !this.statistics) {
    this.statistics = is;
    $("#statistics").setAttribute("aria-pressed", is);
  }

  show() {
    const { signals, statistics } = this, { cursors } = signals;
    this.box.hidden = !cursors.on && !statistics;
    if (this.box.hidden) return;
    const curves = signals.layout === "xy" ? signals.xy.curves : signals.curves;
    const heads = [...(cursors.on ? CURSORS : []), ...(statistics ? STATISTICS : [])];
    const key = [...heads, ...curves.map((curve) => curve.key)].join("\n");
    if (this.key !== key) this.build(heads, curves);
    this.key = key;
    const [from, to] = signals.window();
    const [a, b] = cursors.at;
    if (cursors.on) this.fill("", 0, [instant(a, signals.span / 1e4), instant(b, signals.span / 1e4), `${span(b - a)}${b === a ? "" : ` · ${number(1 / Math.abs(b - a))} Hz`}`]);
    if (statistics) this.fill("", cursors.on ? 3 : 0, [`${instant(Math.max(0, from), signals.span / 1e3)} to ${instant(to, signals.span / 1e3)}`]);
    for (const { key, signal: { series, unit, names }, element } of curves) {
      const texts = [];
      if (cursors.on) {
        const at = series.at(a, element), then = series.at(b, element);
        texts.push(...(names ? [at, then].map((value) => names.get(value) ?? number(value)).concat("") : alike([at, then, then - at])));
      }
      if (statistics) {
        const { mean, rms, least, most } = series.statistics(element, from, to);
        texts.push(...[mean, rms, least, most].map(number));
      }
      this.fill(key, 0, texts.map((text) => text + (unit ? ` ${unit}` : "")));
    }
  }

  fill(key, first, texts) { texts.forEach((text, n) => put(this.cells.get(key)[first + n], text)); }

  build(heads, curves) {
    this.cells.clear();
    const { cursors } = this.signals;
    const line = (key, name) => {
      // The span of the statistics stands above all of them.
      const isTime = key === "" && this.statistics;
      const cells = heads.slice(0, isTime ? (cursors.on ? 4 : 1) : undefined).map((_, n) => make("td", { class: "n", colspan: isTime && n === (cursors.on ? 3 : 0) && STATISTICS.length }));
      this.cells.set(key, cells);
      return make("tr", {}, make("th", { scope: "row" }, name), ...cells);
    };
    const head = make("tr", {}, make("td"), ...heads.map((text) => make("th", { class: "n", scope: "col" }, text)));
    const body = make("tbody", {}, line("", "time"), ...curves.map(({ key, name }) => line(key, name)));
    this.box.replaceChildren(make("table", {}, make("thead", {}, head), body));
  }
}

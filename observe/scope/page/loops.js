// How well each loop keeps its time, and why it did not.

import { $, make, put, spanParts, span, instant, count } from "./text.js";
import { colours, fit } from "./draw.js";

const CAUSES = ["unknown", "the loop itself", "another process of its executor", "another thread on its core"];

// The cause of a late cycle with its share, from the second number of its event; one without a share is not named.
export function lateCause(argument) {
  const cause = argument % 256, percent = Math.floor(argument / 256) % 256;
  return percent ? { cause, percent } : { cause: 0, percent: 0 };
}

// In words: `who` is the process that ran instead, `stolen` the share of a hypervisor.
export function causeText({ cause, percent }, who, stolen) {
  const causes = [];
  if (cause) causes.push(`${who ?? CAUSES[cause] ?? `cause ${cause}`} (${percent} %)`);
  if (stolen) causes.push(`a hypervisor (at least ${stolen} %)`);
  return causes.join("; ") || CAUSES[0];
}

export class Loops {
  constructor(model, clock, show) {
    Object.assign(this, { model, clock, show });
    this.root = $("#loops");
    this.cards = new Map();
    this.note = make("p", { class: "note" }, "How late each cycle began, after its slot. Both scales are logarithmic, so that one late cycle in a million is seen; what lies above p99 is amber.");
    this.grid = make("div", { class: "cards" });
    this.body = make("tbody");
    this.lateHead = make("h2", {}, "Late cycles");
    this.lateCount = make("span", { class: "muted number" });
    const head = make("tr", {}, ...["When", "Loop", "Late by", "Cause", ""].map((text, n) => make("th", { class: n === 2 ? "n" : "", scope: "col" }, text)));
    this.late = make("div", { class: "panel late-cycles" }, make("header", {}, this.lateHead, this.lateCount), make("table", {}, make("thead", {}, head), this.body));
    this.quiet = make("div", { class: "quiet" }, make("div", {}, make("h2", {}, "No loops yet"), make("p", {}, "Here is a histogram for each periodic loop, when the recording has the events of its slots.")));
    this.root.append(this.quiet, this.note, this.grid, this.late);
  }

  frame() {
    const { counts } = this.model;
    if (this.shown === counts && this.version === this.model.version && this.theme === document.documentElement.dataset.theme && this.width === this.root.clientWidth) return;
    Object.assign(this, { shown: counts, version: this.model.version, theme: document.documentElement.dataset.theme, width: this.root.clientWidth });
    const hasLoops = counts.loops.length > 0;
    this.quiet.hidden = hasLoops;
    this.late.hidden = this.note.hidden = !hasLoops;
    for (const one of counts.loops) this.card(one);
    for (const [number, card] of this.cards) {
      if (!counts.loops.some((one) => one.number === number)) { card.root.remove(); this.cards.delete(number); }
    }
    this.table(counts);
  }

  name(number) { return this.model.loops.get(number)?.name ?? `loop ${number}`; }

  card(one) {
    let card = this.cards.get(one.number);
    if (!card) {
      const figures = Object.fromEntries(["p50", "p99", "max"].map((name) => [name, make("dd")]));
      card = { title: make("h2"), count: make("span", { class: "muted number" }), canvas: make("canvas", { role: "img" }), figures };
      const terms = Object.entries(figures).map(([name, value]) => make("div", {}, make("dt", {}, name === "max" ? "greatest" : name), value));
      card.root = make("article", { class: "card" }, make("header", {}, card.title, card.count), make("dl", { class: "figures" }, ...terms), card.canvas);
      this.cards.set(one.number, card);
      this.grid.append(card.root);
    }
    put(card.title, this.name(one.number));
    put(card.count, `${count(one.count)} cycles`);
    for (const [name, element] of Object.entries(card.figures)) {
      const [figure, unit] = spanParts(one[name] / 1e9);
      element.replaceChildren(figure, make("small", {}, ` ${unit}`));
    }
    card.canvas.setAttribute("aria-label", `Histogram of how late ${this.name(one.number)} began: half of its cycles within ${span(one.p50 / 1e9)}, 99 % within ${span(one.p99 / 1e9)}, all within ${span(one.max / 1e9)}`);
    this.histogram(card.canvas, one);
  }

  // Counts and times are on logarithmic scales, so that one late cycle in a million is visible.
  histogram(canvas, { buckets, p50, p99, max }) {
    const { context, width, height } = fit(canvas);
    const palette = colours();
    context.clearRect(0, 0, width, height);
    const bottom = height - 22, left = 34, low = Math.max(100, Math.min(...buckets.map(([from]) => from)) * 0.7);
    const high = Math.max(low * 20, max * 1.4);
    const x = (nanos) => left + (Math.log(Math.max(low, nanos) / low) / Math.log(high / low)) * (width - left);
    const bars = new Map(); // two buckets are a bar
    for (const [from, to, number] of buckets) {
      const size = 2 * (to - from), start = Math.floor(from / size) * size;
      const bar = bars.get(start) ?? { size, number: 0 };
      bars.set(start, { ...bar, number: bar.number + number });
    }
    const tallest = Math.log1p(Math.max(1, ...[...bars.values()].map((bar) => bar.number)));
    const most = Math.max(1, ...[...bars.values()].map((bar) => bar.number));
    const tall = (number) => (Math.log1p(number) / tallest) * (bottom - 10);
    context.font = "12px ui-sans-serif, system-ui, sans-serif";
    // Cycles: decades that have room.
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (let decade = 1, last = Infinity; decade <= most; decade *= 10) {
      const y = bottom - tall(decade);
      if (last - y < 16) continue;
      last = y;
      context.fillStyle = palette.grid;
      context.fillRect(left, Math.round(y), width - left, 1);
      context.fillStyle = palette.faint;
      context.fillText(decade < 1000 ? decade : decade < 1e6 ? `${decade / 1000}k` : `${decade / 1e6}M`, left - 5, y);
    }
    context.textAlign = "center";
    context.textBaseline = "alphabetic";
    for (let decade = 10 ** Math.ceil(Math.log10(low)); decade <= high; decade *= 10) {
      context.fillStyle = palette.grid;
      context.fillRect(Math.round(x(decade)), 4, 1, bottom - 4);
      const text = `${span(decade / 1e9).replace(/\.0+(?= )/, "")}`;
      if (x(decade) > left + 12 && x(decade) < width - 22) { context.fillStyle = palette.faint; context.fillText(text, x(decade), height - 5); }
    }
    for (const [from, { size, number }] of bars) {
      const begin = x(from), end = Math.max(begin + 1.5, x(from + size) - 0.5), high = Math.max(2, tall(number));
      context.fillStyle = from > p99 ? palette.ready : palette.accent;
      context.fillRect(begin, bottom - high, end - begin, high);
    }
    context.fillStyle = palette.line;
    context.fillRect(left, bottom, width - left, 1);
    context.fillStyle = palette.text;
    for (const nanos of [p50, p99]) context.fillRect(Math.round(x(nanos)), bottom - 4, 1.5, 8);
  }

  table({ late, late_in_all }) {
    put(this.lateCount, late_in_all > late.length ? `the last ${late.length} of ${count(late_in_all)}` : late_in_all ? count(late_in_all) : "none");
    const lines = late.slice(-100).reverse().map((one) => {
      const time = this.model.seconds(one.time);
      const bad = one.cause === 1 || one.cause === 2;
      return make("tr", {},
        make("td", { class: "number" }, instant(time, 1e-4)), make("td", {}, this.name(one.loop)), make("td", { class: "n" }, span(one.lateness / 1e9)),
        make("td", { class: "text" }, make("span", { class: `tag ${bad ? "bad" : one.cause || one.stolen_percent ? "warn" : ""}` }, causeText(one, undefined, one.stolen_percent))),
        make("td", { class: "n" }, make("button", { onclick: () => this.show({ ...one, seconds: time }) }, "Show")));
    });
    this.body.replaceChildren(...lines);
  }
}

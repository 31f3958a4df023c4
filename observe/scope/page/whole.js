// The whole run, below the plot: what the plot shows of it, to be dragged or set by a click.

import { $, instant } from "./text.js";
import { fit } from "./draw.js";
import { colourOfMark } from "./marks.js";
import { gestures } from "./gestures.js";

const PAD = 4, CURVES = 8;

export class Whole {
  constructor(signals) {
    this.signals = signals;
    this.canvas = $("#whole");
    const go = (x) => signals.showAt(((x - this.left) / this.width) * signals.model.last);
    gestures(this.canvas, {
      grab: (x) => { go(x); return { drag: go }; },
      pan: (pixels) => signals.pan(pixels),
      zoom: (factor) => signals.zoom(factor),
      home: () => signals.clock.follow(),
    });
    this.canvas.addEventListener("pointerup", () => this.fetch());
    this.canvas.addEventListener("keydown", ({ key }) => key === "Enter" && this.fetch());
  }

  // Gets the samples of what the plot shows, where those of a file are not in memory.
  fetch() {
    const { model, clock, shown } = this.signals, [begin, end] = this.signals.window();
    const from = Math.max(0, begin), to = Math.min(end, model.last);
    const isThere = from >= model.samplesKept(shown) && to <= clock.latest;
    // What is longer than the page's memory would displace itself: it stays an overview.
    const isTooLong = shown.some(({ signal: { series } }) => series.begin > 0 && to - from > series.lastTime - series.keptFrom);
    if (model.until > 0 && !isThere && !isTooLong && !clock.live) this.seek(from, to);
  }

  // The bar begins and ends with the plot's axis.
  get left() { return this.signals.x(this.signals.to - this.signals.span); }
  get width() { return this.signals.plotWidth; }

  draw(curves, palette, from, to) {
    const { canvas } = this, { last } = this.signals.model;
    canvas.hidden = last === 0;
    if (canvas.hidden) return;
    const x = (time) => this.left + (Math.min(last, Math.max(0, time)) / last) * this.width;
    const begin = Math.round(x(from)), end = Math.max(begin + 2, Math.round(x(to)));
    // It is drawn again when the window has moved by a pixel, or some time has come.
    const { clientWidth } = canvas;
    const { marks } = this.signals.model;
    const key = [begin, end, marks.all.length, marks.all.at(-1)?.time, Math.floor(last * 4), clientWidth, palette.theme, ...curves.map(({ key }) => key)].join();
    if (this.key === key) return;
    this.key = key;
    canvas.setAttribute("aria-valuemax", last.toFixed(3));
    canvas.setAttribute("aria-valuenow", Math.max(0, (from + to) / 2).toFixed(3));
    canvas.setAttribute("aria-valuetext", `${instant(Math.max(0, from), 0.01)} to ${instant(to, 0.01)} of ${instant(last, 0.01)}`);
    const { context, width, height } = fit(canvas);
    context.clearRect(0, 0, width, height);
    context.fillStyle = palette.grid;
    context.fillRect(this.left, 0, this.width, height);
    context.fillStyle = palette.surface;
    context.fillRect(begin, 0, end - begin, height);
    for (const { signal: { series: { overview } }, element, colour } of curves.slice(0, CURVES)) {
      const least = overview.least[element], most = overview.most[element];
      let low = Infinity, high = -Infinity;
      for (let at = 0; at < least.length; at++) { if (least[at] < low) low = least[at]; if (most[at] > high) high = most[at]; }
      const scale = (height - 2 * PAD) / (high - low || 1);
      context.fillStyle = colour;
      for (let at = 0; at < least.length; at++) {
        if (least[at] !== least[at]) continue;
        const left = x(at * overview.span), top = height - PAD - (most[at] - low) * scale;
        context.fillRect(left, top, Math.max(1, x((at + 1) * overview.span) - left), Math.max(1, (most[at] - least[at]) * scale));
      }
    }
    for (const { time, kind } of marks.all) {
      context.fillStyle = colourOfMark(palette, kind);
      context.fillRect(x(time) - 0.5, 0, kind === "emergency" ? 2 : 1, kind === "emergency" ? height : 5);
    }
    context.strokeStyle = palette.accent;
    context.lineWidth = 2;
    context.strokeRect(begin, 1, end - begin, height - 2);
  }
}

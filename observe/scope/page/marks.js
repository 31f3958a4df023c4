// Marks on the time axis: emergencies, warnings, late cycles and changed parameters.

import { $, make, put, span, instant } from "./text.js";
import { causeText, lateCause } from "./loops.js";
import { BOTTOM, RIGHT, TOP } from "./draw.js";

const MOST = 4096;
const NEAR = 7; // pixels
const NAMED = 6; // of the marks at one place
// By which signal somebody stopped the program; undefined if nobody did.
export function stopText(signal) {
  const name = { 1: "SIGHUP", 2: "SIGINT", 15: "SIGTERM" }[signal];
  return name && `stopped by ${name}`;
}

const DEGREES = ["normal again", "warning", "safe state", "emergency"];

// All marks of the recording, in the order of time: { time, kind, ... }. Kinds are emergency, stop, error, warning, late and parameter.
export class Marks {
  constructor() { this.all = []; }

  put(mark) {
    const { all } = this;
    let at = all.length;
    while (at > 0 && all[at - 1].time > mark.time) at--;
    all.splice(at, 0, mark);
    if (all.length > MOST) all.splice(0, MOST / 16);
  }

  late(time, loop, lateness, argument) { this.put({ time, kind: "late", loop, lateness: lateness / 1e9, argument }); }
  // The last emergency is declared again after blocks were missed, to a page that may have it.
  emergency(time, process, degree, signal) {
    if (this.between(time - 1e-6, time + 1e-6).some((mark) => mark.process === process && mark.degree === degree)) return;
    const stop = stopText(signal);
    if (stop) this.put({ time, kind: "stop", process, degree, text: stop });
    else this.put({ time, kind: degree > 1 ? "emergency" : "warning", process, degree });
  }

  message({ time, level, text }) { if (level <= 2) this.put({ time, kind: level === 1 ? "error" : "warning", text }); }
  parameter(time, { name, before, value }) { this.put({ time, kind: "parameter", text: `${name}: ${JSON.stringify(before)} → ${JSON.stringify(value)}` }); }

  // The first that is not before an instant.
  find(time) {
    let low = 0, high = this.all.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.all[middle].time < time) low = middle + 1; else high = middle;
    }
    return low;
  }

  between(from, to) { return this.all.slice(this.find(from), this.find(to)); }
}

export const colourOfMark = (palette, kind) => palette[{ warning: "ready", parameter: "accent", stop: "muted" }[kind] ?? "failed"];

// The marks in the plot of the signals.
export class MarkStrip {
  constructor(signals) {
    this.signals = signals;
    this.tip = $(".tip", $("#plot"));
    this.chosen = null;
    this.show = null; // goes to the view that has more of a mark
    $("#mark-next").onclick = () => this.go(1);
    $("#mark-last").onclick = () => this.go(-1);
  }

  text(mark) {
    const { model } = this.signals;
    if (mark.text !== undefined) return mark.text;
    if (mark.kind === "late") return `${model.loops.get(mark.loop)?.name ?? `loop ${mark.loop}`} ${span(mark.lateness)} late: ${causeText(lateCause(mark.argument))}`;
    const raiser = model.processes.get(mark.process)?.name;
    return `${DEGREES[mark.degree] ?? "emergency"}${raiser ? `, raised by ${raiser}` : ""}`;
  }

  isOn(y) { return y > this.signals.over.clientHeight - BOTTOM - 2 && y < this.signals.over.clientHeight - BOTTOM + 18; }

  // Those at a place of the axis.
  at(x) {
    const { signals } = this, [from, to] = [signals.time(x - NEAR), signals.time(x + NEAR)];
    return signals.model.marks.between(from, to);
  }

  // A tap on a mark goes to the view that has more of it.
  tap(x, y) {
    const mark = this.isOn(y) && this.at(x).at(-1);
    if (mark) this.show?.(mark);
    return Boolean(mark);
  }

  // To the next mark, or the one before, from the chosen one or the middle of the plot.
  go(by) {
    const { signals } = this, { marks } = signals.model;
    const isSeen = this.chosen !== null && Math.abs(this.chosen.time - (signals.to - signals.span / 2)) < signals.span / 2;
    const from = isSeen ? this.chosen.time : signals.to - (by > 0 ? signals.span : 0);
    const here = marks.all.indexOf(this.chosen);
    const mark = isSeen && here >= 0 ? marks.all[here + by] : marks.all[by > 0 ? marks.find(from) : marks.find(from) - 1];
    if (!mark) return;
    this.chosen = mark;
    signals.showAt(mark.time);
  }

  draw(context, palette, height, pointer) {
    const { signals } = this, { left } = signals, right = left + signals.plotWidth;
    const y = height - BOTTOM + 8;
    const marks = signals.model.marks.between(signals.to - signals.span, signals.to);
    const last = {};
    for (const { time, kind } of marks) {
      const x = signals.x(time);
      // One for each place; the rest is in its text.
      if (x - (last[kind] ?? -Infinity) < 3) continue;
      last[kind] = x;
      context.fillStyle = colourOfMark(palette, kind);
      if (kind === "emergency") {
        context.globalAlpha = 0.6;
        context.fillRect(x - 0.5, TOP, 1, y - TOP);
        context.globalAlpha = 1;
      }
      shape(context, kind, x, y);
    }
    const isChosen = this.chosen !== null && marks.includes(this.chosen);
    const over = pointer && this.isOn(pointer[1]) && pointer[0] > left ? this.at(pointer[0]) : [];
    const named = over.length > 0 ? over : isChosen ? [this.chosen] : [];
    this.tip.hidden = named.length === 0;
    if (named.length === 0) return;
    const x = signals.x(named[0].time);
    context.fillStyle = palette.text;
    context.globalAlpha = 0.5;
    context.fillRect(x - 0.5, TOP, 1, height - BOTTOM - TOP);
    context.globalAlpha = 1;
    const lines = named.slice(0, NAMED).map((mark) => make("div", {}, make("b", {}, instant(mark.time, 1e-4)), this.text(mark)));
    if (named.length > NAMED) lines.push(make("div", { class: "muted" }, `and ${named.length - NAMED} more`));
    const key = lines.map((line) => line.textContent).join("\n");
    if (this.key !== key) this.tip.replaceChildren(...lines);
    this.key = key;
    const wide = this.tip.offsetWidth;
    this.tip.style.left = `${Math.max(4, Math.min(right + RIGHT - wide - 4, x - wide / 2))}px`;
    this.tip.style.top = `${Math.max(4, height - BOTTOM - this.tip.offsetHeight - 6)}px`;
  }
}

// Each kind has a shape of its own.
function shape(context, kind, x, y) {
  context.beginPath();
  if (kind === "parameter") context.arc(x, y, 4, 0, 7);
  else if (kind === "stop") context.rect(x - 4, y - 4, 8, 8);
  else if (kind === "late") {
    context.moveTo(x, y - 5);
    context.lineTo(x + 5, y);
    context.lineTo(x, y + 5);
    context.lineTo(x - 5, y);
  } else {
    const size = kind === "emergency" ? 6 : 5;
    context.moveTo(x, y - size);
    context.lineTo(x + size, y + size - 1);
    context.lineTo(x - size, y + size - 1);
  }
  context.fill();
}

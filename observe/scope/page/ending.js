// How a run ended, on all views: with its main figures, so that an end does not look like a crash.

import { $, make, span, instant, count } from "./text.js";

// The text and figures of an end; null while the run goes on.
export function ending(model, connection) {
  const { ended, counts, status } = model;
  if (ended === null) {
    if (connection.state !== "away" || model.clock.latest === 0) return null;
    // The end may be among what waits while the page is paused.
    if (connection.wasClosed && connection.kept.length > 0) return { kind: "closed", text: "The scope was closed.", figures: ["Follow shows what came while this page was paused, and how it ended"] };
    return connection.wasClosed
      ? { kind: "closed", text: "The scope was closed before the run ended.", figures: ["this page shows the scope again when it is back"] }
      : { kind: "broken", text: "The connection broke: what happens now is not known.", figures: ["the page tries to connect again each second"] };
  }
  const figures = [];
  const cycles = counts.loops.reduce((sum, one) => sum + one.count, 0);
  if (counts.loops.length > 0) {
    const worst = counts.loops.reduce((one, other) => (other.max > one.max ? other : one));
    figures.push(`${count(cycles)} cycles of ${counts.loops.length} ${counts.loops.length === 1 ? "loop" : "loops"}, ${counts.late_in_all === 0 ? "none" : count(counts.late_in_all)} late`);
    figures.push(`worst: ${model.loops.get(worst.number)?.name ?? `loop ${worst.number}`}, at most ${span(worst.max / 1e9)} late, p99 ${span(worst.p99 / 1e9)}`);
  }
  const failed = [...model.processes.values()].filter(({ state }) => state === 5).map(({ name }) => name);
  if (failed.length > 0) figures.push(`failed: ${failed.slice(0, 3).join(", ")}${failed.length > 3 ? ` and ${failed.length - 3} more` : ""}`);
  if (model.lostInAll > 0) figures.push(`${count(model.lostInAll)} records lost`);
  return { kind: failed.length > 0 ? "failed" : "ended", text: `Run ended: ${status.report ?? (ended > 0 ? `after ${instant(ended, 0.1)}` : "nothing was recorded")}`, figures };
}

export class Ending {
  constructor(model, connection) {
    Object.assign(this, { model, connection });
    this.box = $("#ended");
    this.text = make("b");
    this.figures = make("ul");
    const close = make("button", { onclick: () => { this.hiddenKey = this.key; this.frame(); } }, "Hide");
    this.box.append(make("div", {}, this.text, this.figures), close);
  }

  frame() {
    const end = ending(this.model, this.connection);
    const key = JSON.stringify(end);
    this.box.hidden = end === null || key === this.hiddenKey;
    if (end === null) this.hiddenKey = undefined;
    if (this.key === key) return;
    this.key = key;
    if (end === null) return;
    this.box.dataset.kind = end.kind;
    this.text.textContent = end.text;
    this.figures.replaceChildren(...end.figures.map((text) => make("li", {}, text)));
  }
}

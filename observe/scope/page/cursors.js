// Two cursors. The table below the plot has the values at each, and their differences (readings.js).

import { $ } from "./text.js";

const NEAR = 9;

export class Cursors {
  constructor(signals) {
    this.signals = signals;
    this.on = false;
    this.at = [null, null];
  }

  toggle() {
    this.on = !this.on;
    $("#cursors").setAttribute("aria-pressed", this.on);
    if (!this.on) return;
    const { signals } = this;
    // Values are read off what stands still.
    if (signals.clock.live) signals.clock.pause();
    const [from, to] = signals.window();
    this.at = [from + (to - from) * 0.4, from + (to - from) * 0.6];
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
}

// The last seconds: a lane for each executor and process (figures H.3 to H.5 of the LUNA thesis).

import { $, make, put, multiples, span, instant, step } from "./text.js";
import { colours, fit, gone } from "./draw.js";
import { gestures } from "./gestures.js";
import { CODE, STATES, stateOf } from "./events.js";
import { causeText, lateCause } from "./loops.js";
import { stopText } from "./marks.js";

const AXIS = 28, LOWEST = 22, HIGHEST = 32, RIGHT = 12;
const SHORTEST = 2e-6, LONGEST = 20;
const MOST_ARROWS = 400;
const MOST_KNOWN = 2000; // late cycles with the process that ran instead

// A name that has room, with its middle left out if it is too long.
function shortened(context, name, room) {
  if (context.measureText(name).width <= room) return name;
  let kept = name.length - 2;
  const text = () => `${name.slice(0, Math.floor(kept / 2))}…${name.slice(name.length - Math.ceil(kept / 2))}`;
  while (kept > 2 && context.measureText(text()).width > room) kept--;
  return text();
}

export class Timeline {
  constructor(model, clock) {
    Object.assign(this, { model, clock });
    this.root = $("#timeline");
    this.box = $("#lanes");
    this.canvas = $("canvas", this.box);
    this.tip = $(".tip", this.box);
    this.empty = $(".empty", this.box);
    this.spacer = make("div");
    this.box.append(this.spacer);
    this.span = 0.02;
    this.lane = LOWEST;
    this.lanes = [];
    this.ran = new Map();
    this.longest = 0; // width of a lane's name
    this.measure();
    this.end = null;
    this.version = -1;
    this.arrows = true;
    this.skips = false;
    this.knots = null; // of time that is left out: [instant, instant as it is drawn], rising
    $("#lanes-idle").onclick = () => {
      this.skips = !this.skips;
      $("#lanes-idle").setAttribute("aria-pressed", this.skips);
    };
    $("#lanes-in").onclick = () => this.zoom(0.5);
    $("#lanes-out").onclick = () => this.zoom(2);
    $("#lanes-late").onclick = () => this.lastLate();
    $("#lanes-arrows").onclick = ({ target }) => {
      this.arrows = !this.arrows;
      target.setAttribute("aria-pressed", this.arrows);
    };
    gestures(this.canvas, {
      pan: (pixels) => this.pan(pixels),
      zoom: (factor, x) => this.zoom(factor, x),
      tap: (x) => x > this.gutter && this.clock.pause(Math.min(this.clock.latest, this.time(x))),
      hover: (x, y) => { this.pointer = [x, y]; },
      leave: () => { this.pointer = null; },
      passes: (x) => x < this.gutter,
      home: () => this.clock.follow(),
    });
    this.canvas.addEventListener("keydown", (event) => {
      const down = { ArrowDown: this.lane, ArrowUp: -this.lane, PageDown: this.box.clientHeight / 2, PageUp: -this.box.clientHeight / 2 }[event.key];
      if (down) { event.preventDefault(); this.box.scrollTop += down; }
    });
    this.clock.listeners.add(() => {
      if (this.clock.live) this.end = null;
      else if (this.end === null || this.clock.now < this.end - this.span || this.clock.now > this.end) this.end = this.clock.now + this.span * 0.1;
    });
  }

  key(key) {
    if (key === "l") this.lastLate();
    else if (key === "i") $("#lanes-idle").click();
    else return false;
    return true;
  }

  lastLate() {
    const late = this.model.counts.late.at(-1);
    if (late) this.show(this.model.seconds(late.time), late.lateness / 1e9, late.loop);
  }

  // Goes to an instant, with what was before it, and to the lane of a loop's process.
  show(time, lateness, loop) {
    this.wanted = this.model.loops.get(loop)?.parent;
    this.clock.pause(Math.min(this.clock.latest, time));
    this.span = Math.min(0.1, Math.max(0.0006, lateness * 3));
    this.end = time + this.span * 0.35;
    this.still = null;
  }

  // Room for the names, as far as there is any, and for the lanes. Once a frame: the browser takes long to
  // say how wide an element is, and each event asks.
  measure() {
    const { clientWidth } = this.canvas;
    this.gutter = Math.round(Math.min(Math.max(110, this.longest + 22), Math.max(190, clientWidth * 0.3), clientWidth * 0.46));
    this.wide = Math.max(1, clientWidth - this.gutter - RIGHT);
  }

  x(time) { return this.gutter + ((this.bent(time, 0, 1) - this.to) / this.span + 1) * this.wide; }
  time(x) { return this.bent(this.to - this.span + ((x - this.gutter) / this.wide) * this.span, 1, 0); }

  // Converts an instant to its drawn position, or back: linear between knots.
  bent(value, from, to) {
    const { knots } = this;
    if (knots === null) return value;
    let low = 0, high = knots.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (knots[middle][from] <= value) low = middle; else high = middle;
    }
    const [one, other] = [knots[low], knots[high]];
    return one[to] + ((value - one[from]) / (other[from] - one[from])) * (other[to] - one[to]);
  }

  // Idle spans become short, and the rest fills the window (figure H.4).
  bend(from, to) {
    this.knots = null;
    if (!this.skips) return;
    const { events } = this.model, running = new Map(), gaps = [];
    const least = this.span / 40;
    let idle = null;
    const first = events.find(from), last = events.find(to);
    for (const [number, { state, thread }] of events.statesAt(first)) if (state === 2) running.set(thread, number);
    if (running.size === 0) idle = from;
    for (let index = first; index < last; index++) {
      const slot = index & events.mask, state = stateOf(events.code[slot], events.a[slot]);
      if (state === 0) continue;
      const thread = events.thread[slot], subject = events.subject[slot], time = events.time[slot];
      if (state === 2) {
        if (idle !== null && time - idle > least) gaps.push([idle + least / 8, time - least / 8]);
        idle = null;
        running.set(thread, subject);
      } else if (running.get(thread) === subject) {
        running.delete(thread);
        if (running.size === 0) idle = time;
      }
    }
    if (idle !== null && to - idle > least) gaps.push([idle + least / 8, to]);
    const left = gaps.reduce((sum, [begin, end]) => sum + end - begin, 0);
    const busy = to - from - left;
    if (gaps.length === 0 || gaps.length > 200 || busy <= 0) return;
    const short = (0.25 * this.span) / gaps.length < this.span / 30 ? (0.25 * this.span) / gaps.length : this.span / 30;
    const stretch = (this.span - short * gaps.length) / busy;
    const knots = [[from, from]];
    let drawn = from, at = from;
    for (const [begin, end] of gaps) {
      drawn += (begin - at) * stretch;
      knots.push([begin, drawn]);
      drawn += short;
      knots.push([end, drawn]);
      at = end;
    }
    if (at < to) knots.push([to, to]);
    this.knots = knots.filter(([time], n) => n === 0 || time > knots[n - 1][0]);
    this.gaps = gaps;
  }

  drawGaps(context, palette, height) {
    if (this.knots === null) return;
    context.fillStyle = palette.grid;
    for (const [begin, end] of this.gaps) {
      const left = this.x(begin), right = this.x(end);
      context.fillRect(left, AXIS, right - left, height - AXIS);
    }
  }

  pan(pixels) {
    if (this.clock.live) this.clock.pause();
    this.end = Math.min((this.end ?? this.clock.now) - (pixels / this.wide) * this.span, this.clock.latest + this.span / 2);
  }

  zoom(factor, x) {
    const before = this.span;
    this.span = Math.min(LONGEST, Math.max(SHORTEST, this.span * factor));
    if (this.end === null) return;
    const around = x === undefined ? this.x(this.clock.now) : x;
    this.end += (1 - (around - this.gutter) / this.wide) * (this.span - before);
  }

  declare() {
    this.version = this.model.version;
    this.ran.clear();
    this.lanes = [];
    this.of = new Map(); // lane of a process
    this.executorOf = new Map();
    for (const group of this.model.tree()) {
      this.executorOf.set(group.number, this.lanes.length);
      this.lanes.push({ name: group.name, executor: true });
      for (const { process, depth } of group.processes) {
        this.of.set(process.number, this.lanes.length);
        this.lanes.push({ name: process.name, depth, process });
      }
    }
    const context = this.canvas.getContext("2d");
    context.font = "12.5px ui-sans-serif, system-ui, sans-serif";
    this.longest = Math.max(0, ...this.lanes.map(({ name, executor, depth }) => context.measureText(name).width + (executor ? 14 : 20 + depth * 10)));
    this.empty.hidden = this.lanes.length > 0;
    put(this.empty, "No events yet. Here is what each process did in the last seconds, when the recording has its events.");
  }

  frame() {
    if (this.version !== this.model.version) this.declare();
    this.measure();
    const { clock, model } = this;
    if (!clock.live && clock.speed > 0 && (clock.now > this.end || clock.now < this.end - this.span)) this.end = clock.now + this.span * 0.9;
    const to = this.end ?? clock.now;
    this.to = to;
    put($("#lanes-span"), span(this.span));
    const high = this.box.clientHeight;
    this.lane = Math.floor(Math.max(LOWEST, Math.min(HIGHEST, (high - AXIS - 8) / Math.max(1, this.lanes.length))));
    const room = this.lanes.length * this.lane + AXIS;
    const rest = `${Math.max(0, room - high)}px`;
    if (this.spacer.style.height !== rest) this.spacer.style.height = rest;
    if (this.canvas.style.height !== `${high}px`) this.canvas.style.height = `${high}px`;
    const wanted = this.of.get(this.wanted) * this.lane, shown = wanted - this.box.scrollTop;
    if (shown < 0 || shown + this.lane > high - AXIS) this.box.scrollTop = wanted - (high - AXIS) / 2;
    this.wanted = undefined;
    const surface = fit(this.canvas, this.canvas.clientWidth, high);
    // What stands still is drawn once.
    const still = [to, this.span, clock.now, clock.live, this.version, this.arrows, this.skips, high, surface.width, this.box.scrollTop, document.documentElement.dataset.theme, model.events.end].join();
    if (this.still !== still || surface.changed) {
      this.still = still;
      this.bend(to - this.span, to);
      this.draw(surface, to - this.span, to);
    }
    this.hover();
  }

  draw({ context, width, height }, from, to) {
    const LANE = this.lane;
    const { events } = this.model;
    const palette = colours();
    context.clearRect(0, 0, width, height);
    context.font = "12.5px ui-sans-serif, system-ui, sans-serif";
    context.textBaseline = "middle";
    const { gutter } = this, right = width - RIGHT, scroll = this.box.scrollTop;
    const y = (lane) => AXIS + lane * LANE - scroll;
    this.drawGaps(context, palette, height);
    gone(context, palette, this.x(0), this.x(this.model.eventsKept), [gutter, AXIS, right, height]);
    this.grid(context, palette, from, to, width, height);
    context.save();
    context.beginPath();
    context.rect(gutter, AXIS, right - gutter, height - AXIS);
    context.clip();

    // Bars by state: [x, y, width, height, ...]. Bars narrower than a pixel are summed up for each pixel.
    const bars = { running: [], faint: [], ready: [], waiting: [], failed: [] };
    const names = [], pending = this.lanes.map(() => ({ pixel: -1, running: 0, ready: 0 }));
    const flush = (lane) => {
      const one = pending[lane];
      if (one.pixel < 0) return;
      const top = y(lane);
      if (one.running > 0) bars[one.running > 0.35 ? "running" : "faint"].push(one.pixel, top + 4, 1, LANE - 8);
      else if (one.ready > 0) bars.ready.push(one.pixel, top + 7, 1, LANE - 14);
      one.pixel = -1;
    };
    const bar = (lane, state, begin, end, name) => {
      const top = y(lane);
      if (top < AXIS - LANE || top > height) return;
      const left = Math.max(gutter, this.x(begin)), stop = Math.min(right, this.x(end));
      if (stop < left || state === 0 || state === 4) return;
      if (state === 3) { if (stop - left >= 1) { flush(lane); bars.waiting.push(left, Math.floor(top + LANE / 2), stop - left, 1); } return; }
      if (stop - left < 1) {
        const one = pending[lane], pixel = Math.floor(left);
        if (one.pixel !== pixel) { flush(lane); one.pixel = pixel; one.running = one.ready = 0; }
        if (state === 2) one.running += Math.max(0.02, stop - left); else one.ready += 0.02;
        return;
      }
      flush(lane);
      if (state === 2) bars.running.push(left, top + 4, stop - left, LANE - 8);
      else if (state === 5) bars.failed.push(left, top + 9, stop - left, 4);
      else bars.ready.push(left, top + 7, stop - left, LANE - 14);
      if (name && stop - left > 34) names.push([name, left, top + LANE / 2, stop - left]);
    };

    const first = events.find(from), last = events.find(to);
    const open = new Map(), onExecutor = new Map();
    for (const [number, state] of events.statesAt(first)) open.set(number, state);
    for (const process of this.model.processes.values()) {
      if (!open.has(process.number) && process.base && process.base.time <= from) open.set(process.number, { ...process.base, thread: process.executor });
    }
    for (const [number, state] of open) if (state.state === 2) onExecutor.set(state.thread ?? null, { number, time: state.time });
    const leaves = (thread, time) => {
      const running = onExecutor.get(thread), lane = this.executorOf.get(thread);
      if (running && lane !== undefined) bar(lane, 2, running.time, time, this.model.processes.get(running.number)?.name);
      onExecutor.delete(thread);
    };
    const marks = [];
    for (let index = first; index < last; index++) {
      const slot = index & events.mask, code = events.code[slot], subject = events.subject[slot], time = events.time[slot];
      const state = stateOf(code, events.a[slot]);
      if (state === 0) { if (code !== CODE.slot || marks.length < 4000) marks.push(slot); continue; }
      const lane = this.of.get(subject);
      const before = open.get(subject), thread = events.thread[slot];
      if (before) {
        if (lane !== undefined) bar(lane, before.state, before.time, time);
        if (before.state === 2 && onExecutor.get(before.thread)?.number === subject) leaves(before.thread, time);
      }
      if (state === 2) { leaves(thread, time); onExecutor.set(thread, { number: subject, time }); }
      open.set(subject, { state, time, thread, a: events.a[slot], b: events.b[slot] });
    }
    const now = Math.min(to, this.clock.latest);
    for (const [number, { state, time }] of open) if (this.of.has(number)) bar(this.of.get(number), state, time, now);
    for (const thread of [...onExecutor.keys()]) leaves(thread, now);
    for (let lane = 0; lane < pending.length; lane++) flush(lane);

    const fill = (list, colour, alpha = 1) => {
      context.globalAlpha = alpha;
      context.fillStyle = colour;
      for (let n = 0; n < list.length; n += 4) context.fillRect(list[n], list[n + 1], list[n + 2], list[n + 3]);
      context.globalAlpha = 1;
    };
    fill(bars.waiting, palette.waiting, 0.7);
    fill(bars.ready, palette.ready);
    fill(bars.faint, palette.running, 0.6);
    fill(bars.running, palette.running);
    fill(bars.failed, palette.failed);
    context.fillStyle = palette["on-accent"];
    context.textAlign = "left";
    for (const [name, x, middle, room] of names) {
      context.save();
      context.beginPath();
      context.rect(x, middle - LANE / 2, room - 4, LANE);
      context.clip();
      context.fillText(name, x + 6, middle + 0.5);
      context.restore();
    }
    this.marks(context, palette, marks, y, height);
    context.restore();
    this.names(context, palette, y, width, height);
  }

  grid(context, palette, from, to, width, height) {
    const every = step(from, to, Math.max(2, this.wide / 120));
    context.textAlign = "center";
    context.fillStyle = palette.line;
    context.fillRect(0, AXIS - 1, width, 1);
    const { grid, muted } = palette;
    let labelled = -Infinity;
    for (const time of multiples(every, from, to)) {
      const x = this.x(time);
      if (x - labelled < 84 && this.knots !== null) continue;
      labelled = x;
      context.fillStyle = grid;
      context.fillRect(Math.round(x), AXIS, 1, height - AXIS);
      context.fillStyle = muted;
      if (x > this.gutter + 34 && x < width - 40) context.fillText(instant(time, every), x, AXIS / 2);
    }
    if (this.clock.live) return;
    const x = Math.round(this.x(this.clock.now));
    if (x < this.gutter) return;
    context.fillStyle = palette.accent;
    context.fillRect(x, AXIS - 6, 1.5, height - AXIS + 6);
    context.beginPath();
    context.moveTo(x - 5, AXIS - 8);
    context.lineTo(x + 6.5, AXIS - 8);
    context.lineTo(x + 0.75, AXIS);
    context.fill();
  }

  names(context, palette, y, width, height) {
    const LANE = this.lane;
    context.save();
    context.beginPath();
    context.rect(0, AXIS, this.gutter - 8, height);
    context.clip();
    context.textAlign = "left";
    const { line, text, muted } = palette;
    this.lanes.forEach((lane, n) => {
      const top = y(n);
      if (top < AXIS - LANE || top > height) return;
      if (lane.executor && n > 0) { context.fillStyle = line; context.fillRect(0, top, width, 1); }
      context.font = `${lane.executor ? "600 " : ""}12.5px ui-sans-serif, system-ui, sans-serif`;
      context.fillStyle = lane.executor ? text : muted;
      const left = lane.executor ? 14 : 20 + lane.depth * 10;
      context.fillText(shortened(context, lane.name, this.gutter - 10 - left), left, top + LANE / 2);
    });
    context.restore();
  }

  // Slots, communications, late cycles and emergencies.
  marks(context, palette, marks, y, height) {
    const LANE = this.lane;
    const { events } = this.model;
    let arrows = 0;
    const late = [];
    for (const slot of marks) arrows += events.code[slot] === CODE.communication;
    const middle = (lane) => y(lane) + LANE / 2;
    const draws = this.arrows && arrows <= MOST_ARROWS;
    for (const slot of marks) {
      const x = this.x(events.time[slot]), a = events.a[slot], b = events.b[slot];
      switch (events.code[slot]) {
        case CODE.communication: {
          const from = this.of.get(a), to = this.of.get(b);
          if (!draws || from === undefined || to === undefined || from === to) break;
          const down = to > from ? 1 : -1, end = middle(to) - down * 5;
          context.strokeStyle = context.fillStyle = palette.arrow;
          context.beginPath();
          context.moveTo(x, middle(from));
          context.lineTo(x, end - down * 3);
          context.stroke();
          context.beginPath();
          context.arc(x, middle(from), 2, 0, 7);
          context.moveTo(x - 3.5, end - down * 4);
          context.lineTo(x + 3.5, end - down * 4);
          context.lineTo(x, end + down * 2);
          context.fill();
          break;
        }
        case CODE.slot: {
          const lane = this.laneOfLoop(events.subject[slot]);
          if (lane === undefined) break;
          // From where it should have begun.
          const slotX = this.x(events.time[slot] - b / 1e9);
          context.fillStyle = palette.text;
          context.fillRect(slotX - 0.75, y(lane) + 1, 1.5, LANE - 2);
          break;
        }
        case CODE.late: late.push(slot); break;
        case CODE.emergency:
          context.fillStyle = a === 0 ? palette.running : stopText(b) ? palette.muted : palette.failed;
          context.fillRect(x - 1, AXIS, 2, height);
          break;
      }
    }
    // Without room for all labels, those nearest to the selected instant get one.
    late.sort((one, other) => Math.abs(events.time[one] - this.clock.now) - Math.abs(events.time[other] - this.clock.now));
    const labels = new Map();
    for (const slot of late) this.late(context, palette, events, slot, y, labels);
  }

  // The process that ran on a thread for at least half of the time between two instants.
  ranFor(from, until, thread) {
    const key = `${until} ${thread}`;
    // What has happened stays as it is, and to find it takes a while.
    if (this.ran.size > MOST_KNOWN) this.ran.clear();
    if (!this.ran.has(key)) this.ran.set(key, this.ranMost(from, until, thread));
    return this.model.processes.get(this.ran.get(key))?.name;
  }

  ranMost(from, until, thread) {
    const ran = this.model.events.ranBetween(from, until, thread);
    for (const [number, time] of ran) if (time >= (until - from) / 2) return number;
    return undefined;
  }

  late(context, palette, events, slot, y, labels) {
    const LANE = this.lane;
    const lane = this.laneOfLoop(events.subject[slot]);
    if (lane === undefined) return;
    const began = events.time[slot], lateness = events.a[slot] / 1e9;
    const left = this.x(began - lateness), right = this.x(began), top = y(lane);
    context.fillStyle = palette.failed;
    context.globalAlpha = 0.22;
    context.fillRect(left, top + 1, Math.max(1, right - left), LANE - 2);
    context.globalAlpha = 1;
    context.beginPath();
    context.moveTo(right, top + LANE / 2 - 6);
    context.lineTo(right + 6, top + LANE / 2);
    context.lineTo(right, top + LANE / 2 + 6);
    context.lineTo(right - 6, top + LANE / 2);
    context.fill();
    const known = lateCause(events.b[slot]), instead = known.cause === 2 ? this.ranFor(began - lateness, began, events.thread[slot]) : undefined;
    const text = `${span(lateness)} late: ${causeText(known, instead)}`;
    const wide = context.measureText(text).width;
    const x = Math.min(right + 12, this.canvas.clientWidth - RIGHT - wide - 12);
    const taken = labels.get(lane) ?? [];
    if (taken.some(([from, to]) => x - 4 < to && from < x + wide + 14)) return;
    labels.set(lane, [...taken, [x - 4, x + wide + 14]]);
    context.fillStyle = palette.failed;
    context.beginPath();
    context.roundRect(x - 2, top + 1, wide + 14, LANE - 2, 6);
    context.fill();
    context.fillStyle = palette["on-alarm"];
    context.textAlign = "left";
    context.fillText(text, x + 5, top + LANE / 2 + 0.5);
  }

  laneOfLoop(number) { return this.of.get(this.model.loops.get(number)?.parent); }

  // What the pointer is on.
  hover() {
    const lane = this.pointer && this.pointer[0] > this.gutter ? this.lanes[Math.floor((this.pointer[1] - AXIS + this.box.scrollTop) / this.lane)] : null;
    if (!lane?.process || this.clock.live) { this.tip.hidden = true; return; }
    const { events } = this.model;
    const time = this.time(this.pointer[0]), index = events.find(time);
    const { number, name, base } = lane.process;
    const state = events.statesAt(index).get(number) ?? (base && base.time <= time ? base : null);
    let until = null;
    for (let at = index, most = Math.min(events.end, index + 20_000); at < most && until === null; at++) {
      const slot = at & events.mask;
      if (events.subject[slot] === number && stateOf(events.code[slot], events.a[slot])) until = events.time[slot];
    }
    const word = state ? STATES[state.state] : "not known";
    const reason = state?.state === 3 ? this.model.reason(state.a, state.b) : "";
    const length = state && until !== null ? `, for ${span(until - state.time)}` : "";
    this.tip.replaceChildren(make("b", {}, name), `${word}${reason ? ` for ${reason}` : ""}${length}`);
    this.tip.hidden = false;
    const left = Math.min(this.pointer[0] + 14, this.box.clientWidth - this.tip.offsetWidth - 8);
    this.tip.style.left = `${Math.max(0, left)}px`;
    this.tip.style.top = `${this.pointer[1] + this.box.scrollTop + 18}px`;
  }
}

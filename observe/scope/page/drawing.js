// The elements of a picture that follow processes and channels, as those of a model's drawing do (docs/scope-pictures.md). A text has words; of all else the class is set, once a frame at most.

import { make, put, count, instant } from "./text.js";
import { CODE, STATES, SUBJECT, stateOf } from "./events.js";

const READ = 250; // ms between changes of words, so that they can be read
const LIT = 0.15; // s for which a communication is seen
const WINDOW = 1; // s of which the rates are
const OFTEN = 8; // turns or communications in a second of the page from which on an element shows this, and no longer each of them
const MOST_NAMED = 8;

// What a name has in common with its form in a model: all but letters and digits is `_` there.
const key = (name) => name.replace(/[^\p{L}\p{N}]+/gu, "_").replace(/^_|_$/g, "");

// Things of the recording by the names that a picture may have for them.
class Names {
  constructor(all) {
    this.exact = new Map(all);
    this.keys = new Map(all.map(([name, number]) => [key(name), number]));
    this.shorts = new Map();
    // Of several programs, a name without that of the program is enough if one program alone has it.
    for (const [name, number] of all) {
      const short = key(name.slice(name.indexOf("/") + 1));
      this.shorts.set(short, this.shorts.has(short) ? undefined : number);
    }
  }

  find(name) { return this.exact.get(name) ?? this.keys.get(key(name)) ?? this.shorts.get(key(name)); }
}

// An element that follows one process, or the channels of an arrow.
class Follower {
  constructor(element, kind, names, rooms) {
    Object.assign(this, { element, kind, names, rooms, isText: element.localName === "text" || element.localName === "tspan" });
    this.numbers = [];
    this.own = element.textContent;
    this.is = "";
  }

  set(is) {
    if (this.is === is) return;
    this.is = is;
    this.element.setAttribute("class", `${this.kind} ${is}`);
  }
}

export class Drawing {
  constructor(model, clock) {
    Object.assign(this, { model, clock });
    const button = (text, title, by) => make("button", { title, "aria-label": title, onclick: () => this.step(by) }, text);
    const keys = [...["running", "ready", "waiting", "done", "failed"].map((name) => [name, name]), ["often", "runs often"], ["arrow", "communication"], ["way receiver", "receiver waits"], ["way sender", "sender waits"]];
    this.instant = make("span", { class: "muted number" });
    const steps = make("div", { class: "group", role: "group", "aria-label": "Events" }, button("‹", "The event before (←)", -1), make("span", { class: "word" }, "Events"), button("›", "The next event (→)", 1));
    this.tools = make("div", { class: "legend", hidden: true }, steps, ...keys.map(([kind, text]) => make("span", { class: `key ${kind}` }, text)), this.instant);
    this.reset();
  }

  reset() {
    this.followers = [];
    this.tools.hidden = true;
    this.rates = { processes: new Map(), channels: new Map() };
    this.read = -Infinity;
    this.drawn = null;
  }

  // Takes an element of the picture, if it follows a process or channels.
  bind(element, data) {
    const split = (text) => text.split(";").map((part) => part.trim());
    if (data.process !== undefined) this.followers.push(new Follower(element, "process", [data.process], []));
    else if (data.channel !== undefined) this.followers.push(new Follower(element, "channel", split(data.channel), split(data.fifo ?? "").map(Number)));
    this.tools.hidden = this.followers.length === 0;
  }

  // Finds what the elements follow. Returns what is wrong.
  declare() {
    if (this.followers.length === 0) return [];
    const { model } = this;
    const names = {
      process: new Names([...model.processes.values()].map(({ name, number }) => [name, number])),
      channel: new Names([...model.channels.values()].filter(({ recorded }) => recorded).map(({ recorded, number }) => [recorded, number])),
    };
    const missing = new Set();
    for (const follower of this.followers) {
      follower.numbers = follower.names.map((name) => names[follower.kind].find(name));
      follower.names.forEach((name, n) => follower.numbers[n] === undefined && missing.add(`${follower.kind} ${name}`));
    }
    this.read = -Infinity;
    this.drawn = null;
    if (model.processes.size === 0) return model.clock.latest > 0 ? ["No events are recorded: the drawing stands still."] : [];
    const more = missing.size > MOST_NAMED ? ` and ${missing.size - MOST_NAMED} more` : "";
    return missing.size > 0 ? [`Not seen in the recording: ${[...missing].slice(0, MOST_NAMED).join(", ")}${more}.`] : [];
  }

  frame(now) {
    if (this.followers.length === 0) return;
    const { clock, model: { events } } = this;
    const pace = clock.live ? 1 : clock.speed, stands = pace === 0;
    const drawn = `${clock.now} ${events.end}`;
    if (stands && this.drawn === drawn) return;
    this.drawn = drawn;
    const reads = stands || now - this.read >= READ;
    if (reads) this.read = now;
    const index = events.find(clock.now + 1e-9);
    const states = this.states(index), counts = events.countsAt(index);
    if (reads) this.measure(events.find(clock.now - WINDOW), states, counts);
    const waiting = this.waiting(states);
    const last = counts && Math.max(...[...counts.values()].map(({ time }) => time));
    for (const follower of this.followers) {
      if (follower.kind === "process") this.drawProcess(follower, states.get(follower.numbers[0]), { pace, reads });
      else this.drawChannels(follower, counts, { pace, reads, waiting, last });
    }
    if (reads) put(this.instant, clock.live ? "" : `at ${instant(clock.now, 1e-6)}`);
  }

  // The states before an event; of processes without one in memory, those that the scope knew.
  states(index) {
    const { events, processes } = this.model, states = events.statesAt(index);
    for (const { number, base } of processes.values()) if (base && base.time <= this.clock.now && !states.has(number)) states.set(number, { ...base, turns: 0 });
    return states;
  }

  // Turns and communications from an event on.
  measure(from, states, counts) {
    const { events } = this.model, before = events.statesAt(from), counted = events.countsAt(from);
    const differences = (all, earlier, of) => new Map([...all].map(([number, one]) => [number, Math.max(0, one[of] - (earlier.get(number)?.[of] ?? 0))]));
    this.rates.processes = differences(states, before, "turns");
    this.rates.channels = counts && counted ? differences(counts, counted, "all") : new Map();
  }

  // The processes that wait at each channel.
  waiting(states) {
    const waiting = new Map();
    for (const [number, { state, a, b }] of states) {
      if (state !== 3 || a !== SUBJECT.channel) continue;
      if (!waiting.has(b)) waiting.set(b, new Set());
      waiting.get(b).add(number);
    }
    return waiting;
  }

  drawProcess(follower, known, { pace, reads }) {
    const turns = this.rates.processes.get(follower.numbers[0]) ?? 0;
    const { state, a, b } = known ?? { state: 0 };
    const often = turns * pace >= OFTEN && state < 4;
    if (!follower.isText) follower.set(often ? "often" : STATES[state]);
    else if (reads) put(follower.element, often ? `${count(turns)} turns/s` : state === 0 ? follower.own : this.words(state, a, b));
  }

  words(state, a, b) {
    if (state !== 3) return STATES[state];
    const reason = this.model.reason(a, b);
    return reason ? `waits for ${reason}` : "waits";
  }

  drawChannels(follower, counts, { pace, reads, waiting, last }) {
    const numbers = follower.numbers.filter((number) => number !== undefined);
    const rate = numbers.reduce((sum, number) => sum + (this.rates.channels.get(number) ?? 0), 0);
    if (follower.isText) {
      if (reads) put(follower.element, this.figures(follower, numbers, counts, rate));
      return;
    }
    const time = Math.max(...numbers.map((number) => counts?.get(number)?.time ?? -Infinity));
    // What stands shows the last communication of all.
    const isLit = pace === 0 ? time >= 0 && time === last : this.clock.now - time < LIT * pace;
    if (rate * pace >= OFTEN) follower.set("often");
    else if (isLit) follower.set("lit");
    else follower.set(this.awaits(numbers, waiting));
  }

  // Which end waits, as far as it is known by its communications.
  awaits(numbers, waiting) {
    for (const number of numbers) {
      const { from, to } = this.model.channels.get(number);
      for (const process of waiting.get(number) ?? []) {
        if (to.has(process)) return "receiver";
        if (from.has(process)) return "sender";
      }
    }
    return "still";
  }

  figures(follower, numbers, counts, rate) {
    if (numbers.length === 0) return follower.own;
    if (!counts) return "–";
    const { model } = this;
    const sum = (of) => numbers.reduce((sum, number) => sum + (counts.get(number)?.[of] ?? 0), 0);
    const isWhole = model.eventsFrom === 0 && model.missed === 0 && model.lostInAll === 0 && !model.status.left_out_events;
    const parts = [`${isWhole ? "" : "≥ "}${count(sum("all"))}`, `${count(rate)}/s`];
    follower.rooms.forEach((room, n) => {
      const known = counts.get(follower.numbers[n]) ?? { sent: 0, received: 0 }, held = known.sent - known.received;
      // What the program itself puts in or takes out, outside of all processes, is not recorded.
      if (room > 0 && isWhole && held >= 0 && held <= room) parts.push(`holds ${held}`);
    });
    return parts.join(" · ");
  }

  // To the next event of a process or a channel, or to the one before.
  step(by) {
    if (this.followers.length === 0) return;
    const { clock, model: { events } } = this;
    for (let at = by > 0 ? events.find(clock.now + 1e-9) : events.find(clock.now - 1e-9) - 1; at >= events.begin && at < events.end; at += by) {
      const slot = at & events.mask;
      if (events.code[slot] !== CODE.communication && stateOf(events.code[slot], events.a[slot]) === 0) continue;
      clock.pause(events.time[slot]);
      return;
    }
  }
}

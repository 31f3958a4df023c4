// All that the page knows of the recording.

import { Series } from "./series.js";
import { Events, CODE, SUBJECT, stateOf } from "./events.js";
import { Marks } from "./marks.js";
import { namesIn, place } from "./text.js";

const MOST_MESSAGES = 2000;

export class Model {
  constructor(clock) {
    this.clock = clock;
    this.version = 0; // changes when something is declared
    this.reset();
  }

  reset() {
    this.system = "";
    this.virtual = false;
    this.threads = new Map();
    this.signals = new Map(); // by number: { number, name, unit, description, elements, series, colour }
    this.early = new Map(); // overviews of signals that are not declared yet, by number
    this.processes = new Map();
    this.executors = new Map();
    this.channels = new Map();
    this.loops = new Map();
    this.others = new Map(); // names of barriers, locks and codes, by subject and number
    this.events = new Events();
    this.marks = new Marks();
    this.messages = [];
    this.messagesInAll = 0;
    this.lost = new Map();
    this.missed = 0;
    this.until = 0; // the last instant of a file
    this.known = 0; // the last one that the scope knew when this page came: all until there is on its way
    this.samplesFrom = this.eventsFrom = 0; // what came before was no longer kept when this page came
    this.counts = { loops: [], late: [], late_in_all: 0 };
    this.status = {};
    this.changes = 0; // the number of the last change of a parameter
    this.hasOldMarks = false;
    this.date = null;
    this.samples = 0;
    this.ended = null; // the run's last instant, when it has ended
    this.version++;
  }

  begins(base) { this.base = base; this.version++; }
  session(clock, system) { this.system = system; this.virtual = clock === 2; this.version++; }
  thread(number, name) { this.threads.set(number, name); this.version++; }

  signal(number, elements, name, unit, description) {
    const known = this.signals.get(number);
    if (known && known.name === name && known.elements === elements) return;
    this.signals.set(number, { number, elements, name, unit, description, names: namesIn(description), series: new Series(elements) });
    const overview = this.early.get(number);
    this.early.delete(number);
    if (overview) this.overview(overview);
    this.version++;
  }

  sample(number, time, values) {
    const signal = this.signals.get(number);
    if (!signal) return;
    signal.series.push(time, values);
    this.samples++;
    this.clock.knows(time);
  }

  overview(word) {
    const signal = this.signals.get(word.signal);
    if (!signal) { this.early.set(word.signal, word); return; }
    if (signal.elements !== word.elements.length) return;
    const { overview } = signal.series;
    overview.merge(word);
    overview.isWhole = this.until > 0;
  }

  // Seconds since the recording's first time, of a time as the scope's messages have it.
  seconds(text) { return Number(BigInt(text) - BigInt(Math.round(this.base ?? 0))) / 1e9; }

  // Takes the counts of the loops. Late cycles of which there are no events become marks too.
  count(word) {
    this.counts = word;
    if (this.hasOldMarks || this.base === undefined) return;
    this.hasOldMarks = true;
    for (const one of word.late) {
      const time = this.seconds(one.time);
      if (time < this.eventsFrom) this.marks.late(time, one.loop, one.lateness, one.cause + one.percent * 256);
    }
  }

  // Takes the scope's status: parameters that were changed become marks.
  know(status) {
    this.status = status;
    for (const change of status.changes ?? []) {
      if (change.number <= this.changes || this.base === undefined) continue;
      this.changes = change.number;
      this.marks.parameter(this.seconds(change.time), change);
    }
  }

  // From when on there are events, and samples of some curves: those before were not sent, or have left this page's memory.
  get eventsKept() { return Math.max(this.eventsFrom, this.events.keptFrom); }
  samplesKept(curves) { return Math.max(this.samplesFrom, ...curves.map(({ signal }) => signal.series.keptFrom)); }

  // The last instant that something is known of.
  get last() { return Math.max(this.clock.latest, this.until); }

  message(message) {
    this.messages.push(message);
    this.messagesInAll++;
    if (this.messages.length > MOST_MESSAGES + 200) this.messages.splice(0, 200);
    this.marks.message(message);
    this.clock.knows(message.time);
  }

  process(number) {
    let process = this.processes.get(number);
    if (!process) {
      process = { number, name: `process ${number}`, parent: 0, executor: null, level: null, state: 0, since: 0, a: 0, b: 0, busy: 0, turns: 0, base: null };
      this.processes.set(number, process);
      this.version++;
    }
    return process;
  }

  name(subject, number, parent, name, executor, level) {
    this.version++;
    switch (subject) {
      case SUBJECT.process: {
        const process = this.process(number);
        process.name = name;
        process.parent = parent;
        if (executor) process.executor = executor;
        process.level = level;
        break;
      }
      case SUBJECT.executor: this.executors.set(number, { name, awake: true }); break;
      case SUBJECT.channel: Object.assign(this.channel(number), { name: place(name), recorded: name }); break;
      case SUBJECT.loop: this.loops.set(number, { number, name, parent }); break;
      case SUBJECT.subProcess: break; // not shown, and there may be ever new ones
      default: this.others.set(subject * 4294967296 + number, place(name));
    }
  }

  channel(number) {
    let channel = this.channels.get(number);
    if (!channel) {
      channel = { number, name: `channel ${number}`, recorded: "", sent: 0, received: 0, from: new Set(), to: new Set() };
      this.channels.set(number, channel);
      this.version++;
    }
    return channel;
  }

  // A process is a new user of a channel.
  join(users, process) {
    if (users.has(process)) return;
    users.add(process);
    this.version++;
  }

  // The last state of a process, or the last emergency, sent to a viewer that connects later.
  lastEvent(time, code, subject, a, b, thread) {
    const state = stateOf(code, a);
    if (code === CODE.emergency && (time < this.eventsFrom || this.missed > 0)) this.marks.emergency(time, subject, a, b);
    if (state === 0) return;
    const process = this.process(subject);
    process.base = { time, state, a, b };
    if (process.state === 0) this.enter(process, time, state, a, b, thread);
  }

  event(time, code, subject, a, b, thread) {
    this.events.push(time, code, subject, a, b, thread);
    this.clock.knows(time);
    const state = stateOf(code, a);
    if (state !== 0) this.enter(this.process(subject), time, state, a, b, thread);
    else if (code === CODE.communication) {
      const channel = this.channel(subject);
      // A value that goes through a buffer is sent in one event and received in another.
      if (a || !b) channel.sent++;
      if (b) channel.received++;
      if (a) this.join(channel.from, a);
      if (b) this.join(channel.to, b);
    } else if (code === CODE.asleep || code === CODE.awake) {
      const executor = this.executors.get(subject);
      if (executor) executor.awake = code === CODE.awake;
    } else if (code === CODE.spawned && a) {
      this.process(subject).parent ||= a;
    } else if (code === CODE.late) this.marks.late(time, subject, a, b);
    else if (code === CODE.emergency) this.marks.emergency(time, subject, a, b);
  }

  enter(process, time, state, a, b, thread) {
    if (process.state === 2) process.busy += Math.max(0, time - process.since);
    if (state === 2) {
      process.turns++;
      // The executor is declared with the name, or known from the events' threads.
      if (process.executor === null) { process.executor = thread; this.version++; }
    }
    process.state = state;
    process.since = time;
    if (state === 3) { process.a = a; process.b = b; }
  }

  losses(of, number, lost) { this.lost.set(of * 4294967296 + number, lost); }
  get lostInAll() { let sum = 0; for (const lost of this.lost.values()) sum += lost; return sum; }
  epoch(time, unix) { this.date = { time, unix }; }
  end(time) { this.ended = time; this.clock.knows(time); }

  // What a process waits for, in words.
  reason(a, b) {
    switch (a) {
      case SUBJECT.channel: return this.channels.get(b)?.name ?? (b ? `channel ${b}` : "a channel");
      case SUBJECT.barrier: return `barrier ${this.others.get(a * 4294967296 + b) ?? b}`;
      case SUBJECT.lock: return `lock ${this.others.get(a * 4294967296 + b) ?? b}`;
      case SUBJECT.loop: return `the next slot of ${this.loops.get(b)?.name ?? "its loop"}`;
      default: return "";
    }
  }

  executorName(number) {
    return this.executors.get(number)?.name ?? this.threads.get(number) ?? (number === null ? "not seen to run yet" : `thread ${number}`);
  }

  // Processes by executor, each after its parent: [{ number, name, processes: [{ process, depth }] }].
  tree() {
    const children = new Map(), roots = new Map();
    for (const process of this.processes.values()) {
      const parent = process.parent && this.processes.has(process.parent) ? process.parent : 0;
      const of = parent ? children : roots;
      const key = parent || process.executor;
      if (!of.has(key)) of.set(key, []);
      of.get(key).push(process);
    }
    const walk = (list, depth) => list.sort((a, b) => a.number - b.number).flatMap((process) => [{ process, depth, parts: children.get(process.number) ?? [] }, ...(depth < 40 ? walk(children.get(process.number) ?? [], depth + 1) : [])]);
    return [...roots].sort(([a], [b]) => (a ?? Infinity) - (b ?? Infinity)).map(([number, list]) => ({ number, name: this.executorName(number), processes: walk(list, 0) }));
  }
}

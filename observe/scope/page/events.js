// The last events, in bounded memory, and what follows from them: the states of processes, the counts of channels.

const FIRST = 1 << 14, MOST = 1 << 20;
const BETWEEN = 1 << 12, CHECKPOINTS = MOST / BETWEEN; // events from one checkpoint of all states to the next

export const CODE = { ready: 1, running: 2, waiting: 3, done: 4, communication: 5, alternative: 6, asleep: 7, awake: 8, priority: 9, slot: 10, late: 11, emergency: 12, spawned: 13 };
export const SUBJECT = { process: 1, executor: 2, channel: 3, barrier: 4, lock: 5, loop: 6, code: 7, subProcess: 8 };
export const STATES = ["unknown", "ready", "running", "waiting", "done", "failed"];
const STILL_READY = 255;

// The state that an event leads to, as an index into STATES; 0 if none.
export function stateOf(code, a) {
  if (code === CODE.waiting) return a === STILL_READY ? 1 : 3;
  if (code === CODE.done) return a === 1 || a === 2 ? 5 : 4;
  return code === CODE.ready ? 1 : code === CODE.running ? 2 : 0;
}

export class Events {
  constructor() {
    this.begin = 0;
    this.end = 0;
    this.current = new Map();
    this.counted = new Map();
    this.checkpoints = [];
    this.allocate(FIRST);
  }

  allocate(room) {
    const old = this.time && { ...this };
    this.mask = room - 1;
    this.time = new Float64Array(room);
    this.code = new Uint8Array(room);
    this.thread = new Uint16Array(room);
    this.subject = new Uint32Array(room);
    this.a = new Float64Array(room);
    this.b = new Float64Array(room);
    if (!old) return;
    for (let index = old.begin; index < old.end; index++) {
      const from = index & old.mask, to = index & this.mask;
      for (const column of ["time", "code", "thread", "subject", "a", "b"]) this[column][to] = old[column][from];
    }
  }

  push(time, code, subject, a, b, thread) {
    const room = this.mask + 1;
    if (this.end - this.begin === room) {
      if (room < MOST) this.allocate(room * 2); else this.begin++;
    }
    const last = (this.end - 1) & this.mask;
    const at = this.end & this.mask;
    // Sorts in events that a round of the recorder merged slightly out of order.
    this.time[at] = this.end > this.begin && time < this.time[last] ? this.time[last] : time;
    this.code[at] = code;
    this.thread[at] = thread;
    this.subject[at] = subject;
    this.a[at] = a;
    this.b[at] = b;
    this.apply(this.current, at);
    this.add(this.counted, at);
    this.end++;
    if (this.end % BETWEEN === 0) {
      const [states, counts] = [this.current, this.counted].map((all) => [...all].map(([subject, one]) => [subject, { ...one }]));
      this.checkpoints[(this.end / BETWEEN) % CHECKPOINTS] = { end: this.end, states, counts };
    }
  }

  // From when on the events are in memory: from the start, if none was dropped.
  get keptFrom() { return this.begin > 0 ? this.time[this.begin & this.mask] : 0; }

  find(time) {
    let low = this.begin, high = this.end;
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (this.time[middle & this.mask] < time) low = middle + 1; else high = middle;
    }
    return low;
  }

  // The last checkpoint before `index`, if it is in memory.
  checkpoint(index) {
    let best = null;
    for (const one of this.checkpoints) if (one && one.end <= index && one.end >= this.begin && (!best || one.end > best.end)) best = one;
    return best;
  }

  // The state of each process after the events before `index`: by number { state, time, a, b, turns }. O(processes + events between two checkpoints).
  statesAt(index) {
    const best = this.checkpoint(index);
    const states = new Map();
    if (best) for (const [subject, state] of best.states) states.set(subject, { ...state });
    for (let at = best ? best.end : this.begin; at < index; at++) this.apply(states, at & this.mask);
    return states;
  }

  // The communications of each channel among all events before `index`, also those that were dropped: by number { all, sent, received, time }. What was sent into a buffer is in `sent`, what came out of one in `received`. Null if it is not known any more.
  countsAt(index) {
    const best = this.checkpoint(index);
    if (!best && this.begin > 0) return null;
    const counts = new Map();
    if (best) for (const [channel, one] of best.counts) counts.set(channel, { ...one });
    for (let at = best ? best.end : 0; at < index; at++) this.add(counts, at & this.mask);
    return counts;
  }

  // For how long each process ran on a thread between two instants, by number.
  ranBetween(from, until, thread) {
    const ran = new Map(), first = this.find(from), end = this.find(until);
    const states = this.statesAt(first);
    let running, since = from;
    for (const [number, state] of states) if (state.state === 2 && state.thread === thread) running = number;
    const stop = (time) => { if (running !== undefined) ran.set(running, (ran.get(running) ?? 0) + time - since); };
    for (let at = first; at < end; at++) {
      const slot = at & this.mask, state = stateOf(this.code[slot], this.a[slot]), number = this.subject[slot];
      if (this.thread[slot] !== thread || !(state === 2 || (state && number === running))) continue;
      stop(this.time[slot]);
      running = state === 2 ? number : undefined;
      since = this.time[slot];
    }
    stop(until);
    return ran;
  }

  apply(states, slot) {
    const state = stateOf(this.code[slot], this.a[slot]);
    if (state === 0) return;
    const subject = this.subject[slot];
    let known = states.get(subject);
    if (!known) states.set(subject, (known = { turns: 0 }));
    if (state === 2) known.turns++;
    known.state = state;
    known.time = this.time[slot];
    known.thread = this.thread[slot];
    known.a = this.a[slot];
    known.b = this.b[slot];
  }

  add(counts, slot) {
    if (this.code[slot] !== CODE.communication) return;
    const channel = this.subject[slot], from = this.a[slot] !== 0, to = this.b[slot] !== 0;
    let known = counts.get(channel);
    if (!known) counts.set(channel, (known = { all: 0, sent: 0, received: 0, time: 0 }));
    known.all++;
    if (from && !to) known.sent++;
    if (to && !from) known.received++;
    known.time = this.time[slot];
  }
}

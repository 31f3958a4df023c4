// Processes and their parts, the state of each process, and which channel each waits at.

import { $, make, put, span, instant, count } from "./text.js";
import { STATES, SUBJECT } from "./events.js";
import { draw, layout } from "./graph.js";

// The values that have gone through a channel, each once.
const valuesOf = ({ sent, received }) => Math.max(sent, received);

const READ = 250; // ms between changes of words, so that they can be read

export class Composition {
  constructor(model, clock) {
    Object.assign(this, { model, clock });
    this.root = $("#composition");
    this.tree = $("#tree");
    this.graph = $("#graph");
    this.lines = [];
    this.isGraph = null; // until the width is known
    for (const button of this.root.querySelectorAll("[data-composition]")) button.onclick = () => this.lay(button.dataset.composition === "graph");
    this.boxes = new Map();
    this.rows = new Map();
    this.version = -1;
    this.read = -Infinity;
    this.body = make("tbody");
    const head = make("tr", {}, ...["Channel", "Each s", "Waiting"].map((text, n) => make("th", { class: n === 1 ? "n" : "", scope: "col" }, text)));
    this.channels = make("div", { class: "panel" }, make("header", {}, make("h2", {}, "Channels")), make("table", {}, make("thead", {}, head), this.body));
    $("#channels").append(this.channels);
    this.quiet = make("div", { class: "quiet" }, make("div", {}, make("h2", {}, "No processes yet"), make("p", {}, "Here are the processes of the system with their states, when the recording has its events.")));
    this.tree.before(this.quiet);
  }

  // The graph of processes and channels, or the processes by executor with their parts.
  lay(isGraph) {
    this.isGraph = isGraph;
    for (const button of this.root.querySelectorAll("[data-composition]")) button.setAttribute("aria-pressed", (button.dataset.composition === "graph") === isGraph);
    for (const key of this.root.querySelectorAll(".key.way")) key.hidden = !isGraph;
    this.version = -1;
  }

  place() {
    this.tree.hidden = this.isGraph;
    this.graph.hidden = !this.isGraph;
    this.width = this.root.clientWidth;
    this.lines = [];
    for (const { root } of this.boxes.values()) root.removeAttribute("style");
    if (!this.isGraph) return;
    // A process with parts stands for them where they are not users of channels themselves.
    const { channels } = this.model, users = new Set([...channels.values()].flatMap(({ from, to }) => [...from, ...to]));
    const shown = new Map([...this.boxes].filter(([number, { inner }]) => inner.hidden || users.has(number)));
    const found = layout(shown, channels.values(), this.graph.clientWidth - 32);
    const canvas = $(".canvas", this.graph), svg = $("svg", this.graph);
    canvas.style.width = `${found.width}px`;
    canvas.style.height = `${found.height}px`;
    this.lines = draw(svg, found, (number) => channels.get(number).name, (number) => this.mark(number));
    canvas.replaceChildren(svg, ...[...shown].map(([number, { root, inner }]) => {
      const { x, y, wide } = found.at.get(number);
      root.style.left = `${x}px`;
      root.style.top = `${y}px`;
      root.style.width = `${wide}px`;
      inner.hidden = true;
      return root;
    }));
  }

  declare() {
    this.version = this.model.version;
    if (this.isGraph === null) this.lay(this.root.clientWidth > 700);
    const groups = this.model.tree();
    const before = this.boxes;
    this.boxes = new Map();
    const build = (entries, depth) => {
      const built = [];
      for (const { process, depth: own, parts } of entries) {
        if (own !== depth) continue;
        const box = before.get(process.number) ?? this.box();
        box.process = process;
        put(box.title, process.name);
        this.boxes.set(process.number, box);
        box.root.classList.toggle("whole", parts.length > 0);
        const inner = parts.length ? build(entries.filter(({ process: one }) => this.isIn(one, process)), depth + 1) : [];
        box.inner.replaceChildren(...inner);
        box.inner.hidden = inner.length === 0;
        built.push(box.root);
      }
      return built;
    };
    this.tree.replaceChildren(...groups.map((group) => {
      const processes = `${group.processes.length} ${group.processes.length === 1 ? "process" : "processes"}`;
      return make("section", { class: "executor panel" }, make("header", {}, make("h2", {}, group.name), make("span", { class: "muted" }, processes)), make("div", { class: "boxes" }, ...build(group.processes, 0)));
    }));
    this.quiet.hidden = groups.length > 0;
    this.root.querySelector(".split").hidden = groups.length === 0;
    this.root.querySelector(".legend").hidden = groups.length === 0;
    const known = this.rows;
    this.rows = new Map();
    for (const channel of [...this.model.channels.values()].sort((a, b) => a.number - b.number)) {
      const row = known.get(channel.number) ?? this.row(channel.number);
      row.channel = channel;
      put(row.name, channel.name);
      this.rows.set(channel.number, row);
    }
    this.body.replaceChildren(...[...this.rows.values()].map(({ root }) => root));
    this.channels.hidden = this.rows.size === 0;
    this.place();
  }

  isIn(process, whole) {
    for (let at = process, n = 0; at && n < 40; at = this.model.processes.get(at.parent), n++) if (at.parent === whole.number) return true;
    return false;
  }

  box() {
    const title = make("h3"), words = make("p"), busy = make("i"), inner = make("div", { class: "boxes", hidden: true });
    const root = make("div", { class: "box unknown" }, title, words, inner, make("div", { class: "busy", title: "How much of the time it runs" }, busy));
    return { root, title, words, busy, inner, state: 0, share: 0, seen: 0, at: null };
  }

  row(number) {
    const name = make("td"), rate = make("td", { class: "n" }), waiting = make("td", { class: "muted" });
    const root = make("tr", { tabindex: "0" }, name, rate, waiting);
    root.onclick = () => this.mark(number);
    root.onkeydown = (event) => { if (event.key === "Enter") this.mark(number); };
    return { root, name, rate, waiting, seen: null, at: null, perSecond: null };
  }

  mark(number) {
    this.marked = this.marked === number ? null : number;
    this.read = -Infinity;
  }

  frame(now) {
    if (this.version !== this.model.version || (this.isGraph && this.width !== this.root.clientWidth)) this.declare();
    const { clock, model } = this;
    const isLive = clock.live;
    const states = isLive ? null : model.events.statesAt(model.events.find(clock.now + 1e-9));
    const reads = now - this.read >= READ || this.wasAt !== clock.now && !isLive;
    this.wasAt = clock.now;
    if (reads) this.read = now;
    const waiting = new Map();
    for (const [number, box] of this.boxes) {
      const { process } = box;
      const known = isLive ? process : states.get(number) ?? (process.base && process.base.time <= clock.now ? process.base : { state: 0 });
      if (known.state !== box.state) {
        box.root.classList.remove(STATES[box.state]);
        box.root.classList.add(STATES[known.state]);
        box.state = known.state;
      }
      if (known.state === 3 && known.a === SUBJECT.channel && known.b) {
        if (!waiting.has(known.b)) waiting.set(known.b, []);
        waiting.get(known.b).push(number);
      }
      if (reads) {
        put(box.words, this.words(process, known, isLive));
        box.words.title = box.words.textContent;
        this.busy(box, process, isLive);
        const isMarked = this.marked != null && (this.marks(process, known));
        box.root.classList.toggle("marked", isMarked);
      }
    }
    if (reads) this.showChannels(waiting, isLive);
    if (reads) this.showLines(waiting);
    if (reads) put($("#composition-instant"), isLive ? "" : `at ${instant(clock.now, clock.speed > 0 && clock.speed < 0.5 ? 1e-5 : 1e-6)}`);
  }

  marks(process, known) {
    const channel = this.model.channels.get(this.marked);
    return channel && (channel.from.has(process.number) || channel.to.has(process.number) || (known.state === 3 && known.a === SUBJECT.channel && known.b === this.marked));
  }

  words(process, known, isLive) {
    switch (known.state) {
      case 1: return "ready";
      case 2: return isLive ? this.last(process) : "running";
      case 3: return this.waits(process, known.a, known.b);
      case 4: return "done";
      case 5: return "failed";
      default: return "not seen yet";
    }
  }

  // The last wait. The present state of a process that runs a thousand times a second would only flicker.
  last(process) { return process.a ? this.waits(process, process.a, process.b) : "running"; }

  // What a process waits for, and for whom: those at the other end of the channel.
  waits(process, a, b) {
    const reason = this.model.reason(a, b);
    if (!reason) return "waits";
    const channel = a === SUBJECT.channel && this.model.channels.get(b);
    const others = !channel ? [] : [...(channel.to.has(process.number) ? channel.from : channel.from.has(process.number) ? channel.to : [])];
    const names = others.slice(0, 2).map((number) => this.model.processes.get(number)?.name ?? `process ${number}`);
    return `waits for ${reason}${names.length > 0 ? ` (${names.join(", ")}${others.length > 2 ? " …" : ""})` : ""}`;
  }

  // A line shows which of its ends waits.
  showLines(waiting) {
    for (const { from, to, channel, group } of this.lines) {
      const there = waiting.get(channel) ?? [];
      const is = there.includes(from) ? "sender" : there.includes(to) ? "receiver" : "none";
      if (group.dataset.waits !== is) group.dataset.waits = is;
      group.classList.toggle("marked", this.marked === channel);
    }
  }

  busy(box, process, isLive) {
    const { latest } = this.clock;
    if (isLive && box.at !== null && latest > box.at) {
      const share = Math.min(1, (process.busy - box.seen) / (latest - box.at));
      box.share += (share - box.share) * 0.4;
      const shown = box.share > 0 ? Math.max(0.01, box.share) : 0;
      box.busy.style.transform = `scaleX(${shown.toFixed(3)})`;
      box.root.title = `${process.name}: runs ${(box.share * 100).toFixed(1)} % of the time, ${count(process.turns)} turns`;
    }
    box.seen = process.busy;
    box.at = latest;
  }

  showChannels(waiting, isLive) {
    const { latest } = this.clock;
    for (const [number, row] of this.rows) {
      put(row.waiting, (waiting.get(number) ?? []).map((one) => this.model.processes.get(one).name).join(", ") || "–");
      row.root.classList.toggle("chosen", this.marked === number);
      if (!isLive) continue;
      if (row.at !== null && latest - row.at >= 0.4) {
        const rate = (valuesOf(row.channel) - row.seen) / (latest - row.at);
        row.perSecond = row.perSecond === null ? rate : row.perSecond + (rate - row.perSecond) * 0.5;
        put(row.rate, count(row.perSecond));
      }
      if (row.at === null || latest - row.at >= 0.4) { row.seen = valuesOf(row.channel); row.at = latest; }
    }
  }
}

// The editor: what the program sends is shown, what the user does is sent.

import { Canvas } from "./canvas.js";
import { Findings, circleMarks, count, timeMarks } from "./findings.js";
import { Panel } from "./panel.js";
import { Talk } from "./talk.js";
import { connect, unused } from "./wires.js";

const find = (id) => document.getElementById(id);
const token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";

class Editor {
  constructor() {
    this.within = null;
    this.chosen = null;
    this.checked = null;
    this.times = null;
    for (const name of ["choose", "enter", "thing", "apply", "remove"]) this[name] = this[name].bind(this);
    this.canvas = new Canvas(find("canvas"), {
      choose: this.choose,
      remove: this.remove,
      open: () => this.open(),
      moved: (name, x, y) => this.apply([{ do: "set", thing: this.thing("part", name), key: "at", value: [x, y] }]),
      joined: (a, b) => this.join(a, b),
    });
    this.panel = new Panel(find("panel"), this);
    this.findings = new Findings(find("findings"), this.choose);
    this.talk = new Talk(token, () => this.say("The program has ended, or this page has not its token: start luna model edit, and open the address that it prints.", "lost"));
    this.buttons();
  }

  async start() {
    await this.take(await this.talk.ask({ type: "look", version: 0 }));
    this.canvas.whole();
    setInterval(() => this.look(), 1000);
  }

  /** Other programs and other pages may have changed the file. */
  async look() {
    if (this.isLooking) return;
    this.isLooking = true;
    const answer = await this.talk.ask({ type: "look", version: this.state.version });
    if (answer.type === "view") await this.take(answer);
    this.isLooking = false;
  }

  thing(kind, name) {
    return { kind, within: kind === "process" ? null : this.within, name };
  }

  /** Sends edits as one step. Returns whether they were done. */
  async apply(edits) {
    if (edits.length === 0) return true;
    return this.take(await this.talk.ask({ type: "edit", edits }));
  }

  async take(answer) {
    if (answer.type !== "view") {
      this.panel.refuse(answer.error);
      return false;
    }
    const isNew = answer.version !== this.state?.version;
    this.state = answer;
    if (isNew) {
      this.checked = null;
      this.times = null;
      this.show();
    }
    this.status();
    this.panel.refuse(answer.refused?.error);
    // A box that was dragged is where it was.
    if (answer.refused && !isNew) this.canvas.draw(this.scope, answer.view.processes);
    this.mark();
    if (isNew && this.wantsTimes) await this.askTimes();
    return !answer.refused;
  }

  show() {
    const { view } = this.state;
    this.scope = view.scopes.find((one) => one.within === this.within) ?? view.scopes[0];
    this.within = this.scope.within;
    const names = view.scopes.map((one) => one.within ?? "");
    find("scope").replaceChildren(...names.map((name) => new Option(name || "the system", name, false, name === (this.within ?? ""))));
    const before = find("new-part").value;
    find("new-part").replaceChildren(...view.processes.map((one) => new Option(one.name, one.name, false, one.name === before)));
    this.canvas.draw(this.scope, view.processes);
    this.panel.show(this.chosen);
    this.findings.show(this.checked, this.times);
  }

  status() {
    const { state } = this;
    find("name").textContent = state.view.name || state.file;
    find("undo").disabled = !state.undo;
    find("redo").disabled = !state.redo;
    find("max-states").placeholder = state.max_states ?? "";
    const saved = find("saved");
    saved.textContent = state.is_saved ? "Saved" : "Draft: not written yet";
    saved.dataset.is = state.is_saved ? "saved" : "draft";
    this.say(state.problem?.error ?? state.note, state.problem ? "problem" : "note");
  }

  say(text, kind) {
    const bar = find("bar");
    bar.textContent = text ?? "";
    bar.dataset.is = kind;
    bar.hidden = !text;
  }

  /** What is wrong, and what was found, at its place. */
  mark() {
    const { view, problem, refused } = this.state;
    const marks = new Map();
    circleMarks(view, this.scope, this.checked, marks);
    timeMarks(view, this.scope, this.times, marks);
    const wrong = (thing, error) => {
      if (!thing) return;
      const note = error.split(": ")[1] ?? error;
      if (thing.kind === "process") {
        for (const part of this.scope.parts) if (part.process === thing.name) marks.set(`part ${part.name}`, { wrong: true, note });
      } else if ((thing.within ?? null) === this.within) marks.set(`${thing.kind} ${thing.name}`, { wrong: true, note });
    };
    if (problem) wrong(problem.thing, problem.error);
    if (refused) wrong(refused.thing, refused.error);
    this.canvas.mark(marks);
  }

  choose(id) {
    if (id === this.chosen) return;
    this.chosen = id;
    this.canvas.choose(id);
    this.panel.show(id);
  }

  enter(process) {
    this.within = process;
    this.chosen = null;
    this.show();
    this.mark();
    this.canvas.whole();
  }

  open() {
    const part = this.scope.parts.find((one) => `part ${one.name}` === this.chosen);
    const process = this.state.view.processes.find((one) => one.name === part?.process);
    if (process?.body === null) this.enter(process.name);
  }

  async join(a, b) {
    const { edits, error, name } = connect(this.scope, a, b);
    if (error) this.panel.refuse(error);
    else if ((await this.apply(edits)) && name) this.choose(`channel ${name}`);
  }

  async remove() {
    const [kind, name] = (this.chosen ?? "").split(" ");
    if (!["part", "channel", "process"].includes(kind)) return;
    // With the channels that only this part used.
    const idle = kind === "part" ? unused(this.scope, [], (part) => part === name) : [];
    const edits = [{ do: "remove", thing: this.thing(kind, name) }, ...idle.map((one) => ({ do: "remove", thing: this.thing("channel", one) }))];
    if (await this.apply(edits)) this.choose(null);
  }

  async renameProcess(thing, to) {
    const was = this.chosen;
    if ((await this.apply([{ do: "rename", thing, to }])) && was === `process ${thing.name}`) this.choose(`process ${to}`);
  }

  unusedName(base, taken) {
    let name = base;
    for (let n = 2; taken.some((one) => one.name === name); n++) name = `${base}${n}`;
    return name;
  }

  async addProcess() {
    const name = this.unusedName("Process", this.state.view.processes);
    const keys = [["body", "loop { work }"]];
    if (await this.apply([{ do: "add", thing: this.thing("process", name), keys }])) this.choose(`process ${name}`);
  }

  async addPart() {
    const process = find("new-part").value;
    if (!process) return;
    const name = this.unusedName(process[0].toLowerCase() + process.slice(1), this.scope.parts);
    const keys = [["process", process], ["at", this.canvas.center()]];
    if (await this.apply([{ do: "add", thing: this.thing("part", name), keys }])) this.choose(`part ${name}`);
  }

  /** On a connection of its own: editing goes on meanwhile. */
  async check() {
    const { version } = this.state;
    const button = find("check"), most = Number(find("max-states").value);
    button.disabled = true;
    this.say("It is checked …", "note");
    const talk = new Talk(token, () => {});
    const told = setInterval(async () => {
      const { looked_at, known } = await this.talk.ask({ type: "progress" });
      if (button.disabled) this.say(`It is checked: ${count(looked_at)} states looked at, ${count(known)} known.`, "note");
    }, 500);
    const answer = await talk.ask({ type: "check", max_states: most >= 1 ? Math.floor(most) : null });
    clearInterval(told);
    talk.close();
    button.disabled = false;
    this.status();
    if (answer.type !== "checked") return this.panel.refuse(answer.error);
    if (version !== this.state.version) return this.say("The model was changed while it was checked: check it again.", "note");
    this.checked = answer;
    const wasHidden = find("findings").hidden;
    this.findings.show(this.checked, this.times);
    this.mark();
    if (wasHidden) this.canvas.whole();
  }

  async askTimes() {
    const answer = await this.talk.ask({ type: "times" });
    if (answer.type !== "times") return this.panel.refuse(answer.error);
    this.times = answer.table;
    this.findings.show(this.checked, this.times);
    this.mark();
  }

  async toggleTimes() {
    this.wantsTimes = !this.wantsTimes;
    find("times").setAttribute("aria-pressed", this.wantsTimes);
    this.times = null;
    if (this.wantsTimes) return this.askTimes();
    this.findings.show(this.checked, null);
    this.mark();
  }

  buttons() {
    const step = async (type) => this.take(await this.talk.ask({ type }));
    const on = { "add-process": () => this.addProcess(), "add-part": () => this.addPart(), undo: () => step("undo"), redo: () => step("redo"), fit: () => this.canvas.whole(), check: () => this.check(), times: () => this.toggleTimes() };
    for (const [id, act] of Object.entries(on)) find(id).onclick = act;
    find("scope").onchange = (event) => this.enter(event.target.value || null);
    document.addEventListener("keydown", (event) => {
      const isText = event.target.matches?.("input, textarea");
      if (!event.ctrlKey || isText || !"zy".includes(event.key)) return;
      event.preventDefault();
      step(event.key === "y" ? "redo" : "undo");
    });
  }
}

// As the browser's, also when that changes.
const dark = matchMedia("(prefers-color-scheme: dark)");
const theme = () => { document.documentElement.dataset.theme = dark.matches ? "dark" : "light"; };
dark.addEventListener("change", theme);
theme();

window.editor = new Editor();
await window.editor.start();

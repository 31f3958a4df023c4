// The side panel: the properties of what is chosen.

import { get } from "./wires.js";

const RUN = [
  ["priority", "0 to 31"],
  ["period", "1 ms"],
  ["on", "executor"],
  ["cost", "120 us"],
  ["longest_poll", "40 us"],
  ["deadline", "900 us"],
];

const whole = (text) => /^-?\d+$/.test(text);

function make(kind, properties = {}, ...children) {
  const element = Object.assign(document.createElement(kind), properties);
  element.append(...children);
  return element;
}

export class Panel {
  /** `editor` has state, scope, thing(kind, name), apply(edits), choose(id), enter(process), remove(). */
  constructor(element, editor) {
    this.element = element;
    this.editor = editor;
    this.lists = 0;
  }

  /** Shows what is chosen. What is being typed elsewhere keeps its focus. */
  show(id) {
    const focused = this.element.contains(document.activeElement) ? document.activeElement.dataset.key : null;
    this.error = make("p", { className: "error", hidden: true });
    this.error.setAttribute("role", "alert");
    this.element.replaceChildren(this.error, ...this.content(id));
    if (focused) this.element.querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus();
  }

  /** Beside what was refused; what was typed stays. */
  refuse(text) {
    this.error.textContent = text ?? "";
    this.error.hidden = !text;
    if (text) this.error.scrollIntoView({ block: "nearest" });
  }

  content(id) {
    const { scope, state } = this.editor;
    const [kind, name] = (id ?? "").split(" ");
    const found = (list) => list.find((one) => one.name === name);
    const part = kind === "part" && found(scope.parts);
    const channel = kind === "channel" && found(scope.channels);
    const process = kind === "process" && found(state.view.processes);
    if (part) return this.part(part);
    if (channel) return this.channel(channel);
    if (process) return this.process(process);
    return this.overview();
  }

  overview() {
    const { scope, state, choose } = this.editor;
    const button = (id, text) => make("li", {}, make("button", { className: "small", textContent: text, onclick: () => choose(id) }));
    const list = (title, items) => [make("h3", { textContent: title }), make("ul", {}, ...items)];
    return [
      make("h2", { textContent: scope.within ? `Process ${scope.within}` : "System" }),
      make("p", { className: "muted", textContent: "Drag a box to move it. Drag from a port to another one to connect them. Choose something to see its properties." }),
      ...list("Processes", state.view.processes.map((one) => button(`process ${one.name}`, one.name))),
      ...list("Parts", scope.parts.map((one) => button(`part ${one.name}`, one.name))),
      ...list("Channels", scope.channels.map((one) => button(`channel ${one.name}`, one.name))),
      make("h3", { textContent: "New channel" }),
      this.adder("channel", (name) => [{ do: "add", thing: this.editor.thing("channel", name) }]),
    ];
  }

  adder(what, edits) {
    const input = make("input", { placeholder: "name" });
    input.dataset.key = `new ${what}`;
    input.setAttribute("aria-label", `Name of the new ${what}`);
    const add = () => input.value && this.editor.apply(edits(input.value));
    input.onkeydown = (event) => event.key === "Enter" && add();
    return make("div", { className: "row" }, make("span"), input, make("button", { className: "small", textContent: "Add", onclick: add }));
  }

  /** A text that is saved when it was changed; empty removes the key. */
  field(label, key, value, save, { hint = "", options = null } = {}) {
    const input = make("input", { value: value ?? "", placeholder: hint });
    input.dataset.key = key;
    const row = make("label", { className: "row" }, label, input);
    if (options) {
      const list = make("datalist", { id: `list-${this.lists++}` }, ...options.map((value) => make("option", { value })));
      input.setAttribute("list", list.id);
      row.append(list);
    }
    input.onchange = () => save(input.value.trim());
    return row;
  }

  set(thing, key, number = false) {
    return (text) => {
      const value = text === "" ? null : number && whole(text) ? Number(text) : text;
      return this.editor.apply([{ do: "set", thing, key, value }]);
    };
  }

  name(thing) {
    const rename = async (to) => {
      const done = await this.editor.apply([{ do: "rename", thing, to }]);
      if (done) this.editor.choose(`${thing.kind} ${to}`);
    };
    return this.field("name", "name", thing.name, rename);
  }

  removal(text) {
    return make("button", { className: "small", textContent: text, onclick: () => this.editor.remove() });
  }

  part(part) {
    const { state, scope, enter, thing: of } = this.editor;
    const thing = of("part", part.name);
    const process = state.view.processes.find((one) => one.name === part.process);
    const channels = [...scope.channels.map((one) => one.name + (get(one.keys, "array") ? "[i]" : "")), ...scope.ports.map(([name]) => name)];
    const options = { executors: state.view.executors, processes: state.view.processes.map((one) => one.name) };
    const ports = new Map(process?.ports ?? part.bind.map(([port]) => [port, ""]));
    for (const [port] of part.bind) if (!ports.has(port)) ports.set(port, "unknown");
    const parameters = new Map(process?.parameters ?? []);
    const shown = [
      make("h2", { textContent: `Part ${part.name}` }),
      this.name(thing),
      this.field("process", "process", part.process, this.set(thing, "process"), { options: options.processes }),
      this.field("array", "array", part.array, this.set(thing, "array", true), { hint: "one" }),
      make("h3", { textContent: "Ports" }),
      ...[...ports].map(([port, side]) => this.field(`${port} (${side})`, `bind.${port}`, get(part.bind, port), this.set(thing, `bind.${port}`), { options: channels, hint: "channel" })),
      make("h3", { textContent: "Runs" }),
      ...RUN.map(([key, hint]) => this.field(key.replace("_", " "), key, get(part.run, key), this.set(thing, key, key === "priority"), { hint, options: key === "on" ? options.executors : null })),
    ];
    if (parameters.size) shown.push(make("h3", { textContent: "Parameters" }));
    for (const [name, value] of parameters) {
      shown.push(this.field(name, `set.${name}`, get(part.set, name), this.set(thing, `set.${name}`, true), { hint: value }));
    }
    shown.push(make("p", {}, this.removal("Remove part"), " "));
    if (part.is_placed) shown.at(-1).append(make("button", { className: "small", textContent: "Lay out", title: "Forget where it was moved to", onclick: () => this.set(thing, "at")("") }), " ");
    if (process?.body === null) shown.at(-1).append(make("button", { className: "small", textContent: "Show its parts", onclick: () => enter(process.name) }));
    return process ? [...shown, make("hr"), ...this.process(process)] : shown;
  }

  channel(channel) {
    const thing = this.editor.thing("channel", channel.name);
    const key = (key, hint, number) => this.field(key, key, get(channel.keys, key), this.set(thing, key, number), { hint });
    return [
      make("h2", { textContent: `Channel ${channel.name}` }),
      this.name(thing),
      key("type", "0..9, bool, a name", false),
      key("buffer", "rendezvous, fifo 2", false),
      key("array", "one", true),
      make("p", {}, this.removal("Remove channel")),
    ];
  }

  process(process) {
    const thing = { kind: "process", within: null, name: process.name };
    const chosen = this.editor.chosen === `process ${process.name}`;
    const uses = this.editor.state.view.scopes.flatMap((scope) => scope.parts).filter((part) => part.process === process.name).length;
    const shown = [
      make("h2", { textContent: `Process ${process.name}` }),
      make("p", { className: "muted", textContent: uses === 1 ? "of one part" : `of ${uses} parts` }),
      this.renamed(thing),
      ...this.table(thing, "ports", process.ports, "send or receive", ["send", "receive"]),
      ...this.table(thing, "parameters", process.parameters, "number"),
      ...this.table(thing, "variables", process.variables, "0..9 = 1"),
    ];
    if (process.body === null) return [...shown, make("button", { className: "small", textContent: "Show its parts", onclick: () => this.editor.enter(process.name) })];
    const body = make("textarea", { value: process.body, spellcheck: false });
    body.dataset.key = "body";
    body.setAttribute("aria-label", "Body");
    body.onchange = () => this.set(thing, "body")(body.value);
    shown.push(make("h3", { textContent: "Body" }), body);
    if (chosen) shown.push(make("p", {}, this.removal("Remove process")));
    return shown;
  }

  renamed(thing) {
    return this.field("name", "process name", thing.name, (to) => this.editor.renameProcess(thing, to));
  }

  /** Names with values; an empty value removes a name. */
  table(thing, table, pairs, hint, options = null) {
    const number = table === "parameters";
    const rows = pairs.map(([name, value]) => this.field(name, `${table}.${name}`, value, this.set(thing, `${table}.${name}`, number), { hint: "removed", options }));
    const name = make("input", { placeholder: "name" });
    const value = make("input", { placeholder: hint });
    name.dataset.key = `new ${table}`;
    value.dataset.key = `new ${table} value`;
    name.setAttribute("aria-label", `New of ${table}: name`);
    value.setAttribute("aria-label", `New of ${table}: value`);
    const add = () => name.value && value.value && this.set(thing, `${table}.${name.value.trim()}`, number)(value.value.trim());
    value.onchange = add;
    const row = make("div", { className: "row" }, name, value, make("button", { className: "small", textContent: "Add", onclick: add }));
    return [make("h3", { textContent: table[0].toUpperCase() + table.slice(1) }), ...rows, row];
  }
}

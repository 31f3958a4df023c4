// What processes have written.

import { $, make, put, instant, count } from "./text.js";

const LEVELS = ["", "error", "warning", "info", "debug", "trace"];
const SHOWN = 300;

export class Messages {
  constructor(model) {
    this.model = model;
    this.root = $("#messages");
    this.least = make("select", { "aria-label": "What matters at least so much" }, ...[1, 2, 3, 4, 5].map((level) => make("option", { value: level }, level === 1 ? "errors" : level === 2 ? "warnings and errors" : level === 5 ? "all" : `down to ${LEVELS[level]}`)));
    this.least.value = 5;
    this.filter = make("input", { type: "search", placeholder: "Find in messages", "aria-label": "Find in messages" });
    this.count = make("span", { class: "muted number" });
    this.body = make("tbody");
    const head = make("tr", {}, ...["When", "", "From", "Message"].map((text) => make("th", { scope: "col" }, text)));
    this.root.append(make("div", { class: "tools" }, this.least, this.filter, this.count), make("div", { class: "panel said" }, make("table", {}, make("thead", {}, head), this.body)));
  }

  frame() {
    const key = [this.model.messagesInAll, this.least.value, this.filter.value, this.model.version].join("\n");
    if (this.key === key) return;
    this.key = key;
    const wanted = this.filter.value.toLowerCase();
    const found = this.model.messages.filter(({ level, text, target }) => level <= Number(this.least.value) && (text + target).toLowerCase().includes(wanted));
    put(this.count, found.length === 0 ? "none" : found.length > SHOWN ? `the last ${SHOWN} of ${count(found.length)}` : count(found.length));
    this.body.replaceChildren(...found.slice(-SHOWN).reverse().map(({ time, level, process, thread, target, text, cut }) => {
      const from = this.model.processes.get(process)?.name ?? target ?? this.model.executorName(thread);
      return make("tr", {}, make("td", { class: "number" }, instant(time, 1e-3)), make("td", {}, make("span", { class: `tag ${level === 1 ? "bad" : level === 2 ? "warn" : ""}` }, LEVELS[level] ?? level)), make("td", { title: target }, from), make("td", { class: "text" }, cut ? `${text} …` : text));
    }));
  }
}

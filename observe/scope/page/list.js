// The list of signals: which are chosen, their values, and their scale and offset in the plot.

import { $, make, put, number } from "./text.js";
import { colourOf } from "./draw.js";

const CHOSEN_AT_FIRST = 6;

export class List {
  constructor(model, clock) {
    Object.assign(this, { model, clock });
    this.chosen = new Set();
    this.chosenByHand = false;
    this.rows = new Map(); // by name: { signal, element, place, gain, offset, ... }
    this.version = -1;
    this.adjusted = new Map(); // by name: [gain, offset], for signals that are not declared yet
    $("#signal-filter").oninput = () => this.filter();
    $("#signals-all").onclick = () => this.all();
  }

  // What is plotted: { key, name, signal, element, colour }.
  get curves() {
    const curves = [];
    for (const row of this.rows.values()) if (this.chosen.has(row.key)) curves.push(this.curve(row));
    return curves;
  }

  curve({ signal, element, key, name, place }) { return { signal, element, key, name, colour: colourOf(place) }; }

  // Takes what is declared. Returns whether that has changed.
  declare() {
    if (this.version === this.model.version) return false;
    this.version = this.model.version;
    const before = this.rows;
    this.rows = new Map();
    for (const signal of [...this.model.signals.values()].sort((a, b) => a.number - b.number)) {
      for (let element = 0; element < signal.elements; element++) {
        const name = signal.elements > 1 ? `${signal.name}[${element}]` : signal.name;
        const key = name;
        const place = this.rows.size;
        const row = before.get(key) ?? this.row(key, name);
        Object.assign(row, { signal, element, place, key, name });
        row.item.title = [name, signal.unit && `in ${signal.unit}`, signal.description].filter(Boolean).join(", ");
        this.rows.set(key, row);
        if (!this.chosenByHand && this.chosen.size < CHOSEN_AT_FIRST) this.chosen.add(key);
      }
    }
    $("#signal-list").replaceChildren(...[...this.rows.values()].map((row) => row.item));
    this.paint();
    this.filter();
    return true;
  }

  row(key, name) {
    const box = make("input", { type: "checkbox" });
    const swatch = make("span", { class: "swatch" });
    const value = make("span", { class: "value" });
    const figure = document.createTextNode(""), unit = make("small");
    value.append(figure, unit);
    const more = make("button", { class: "more", "aria-expanded": "false", "aria-label": `Scale and offset of ${name}`, title: "Scale and offset" }, "⋯");
    const input = (what) => make("input", { type: "number", step: "any", "aria-label": `${what} of ${name}` });
    const scale = input("Scale"), shift = input("Offset");
    const settings = make("div", { class: "settings", hidden: true }, "× ", scale, " + ", shift);
    more.onclick = () => more.setAttribute("aria-expanded", (settings.hidden = !settings.hidden) ? "false" : "true");
    const item = make("li", {}, make("label", {}, box, swatch, make("span", { class: "name" }, name), value), more, settings);
    box.onchange = () => {
      this.chosenByHand = true;
      this.chosen[box.checked ? "add" : "delete"](key);
      this.paint();
    };
    const row = { item, box, swatch, figure, unit };
    row.adjust = (gain, offset) => {
      Object.assign(row, { gain: gain || 1, offset: offset || 0 });
      scale.value = row.gain;
      shift.value = row.offset;
    };
    row.adjust(...(this.adjusted.get(key) ?? []));
    scale.onchange = shift.onchange = () => row.adjust(Number(scale.value), Number(shift.value));
    return row;
  }

  paint() {
    for (const { key, box, swatch, unit, signal, place } of this.rows.values()) {
      box.checked = this.chosen.has(key);
      swatch.style.background = swatch.style.borderColor = box.checked ? colourOf(place) : "";
      put(unit, signal.unit);
    }
  }

  filter() {
    const wanted = $("#signal-filter").value.toLowerCase();
    for (const { item, name } of this.rows.values()) item.hidden = !name.toLowerCase().includes(wanted);
  }

  all() {
    this.chosenByHand = true;
    const found = [...this.rows.values()].filter(({ item }) => !item.hidden).map(({ key }) => key);
    const add = found.some((key) => !this.chosen.has(key));
    for (const key of found) this.chosen[add ? "add" : "delete"](key);
    this.paint();
  }

  // The figures: the last value, or the value at the selected instant.
  values() {
    const at = this.clock.live ? Infinity : this.clock.now;
    for (const row of this.rows.values()) {
      const { signal, element, figure } = row;
      const { series } = signal;
      const value = at === Infinity ? (series.end > series.begin ? series.value(series.end - 1, element) : NaN) : series.at(at, element);
      // The number of decimals follows from the greatest value, so that the figures do not jump.
      row.peak = Math.max(row.peak ?? 0, Math.abs(value) || 0);
      const decimals = Math.max(0, Math.min(4, 3 - Math.floor(Math.log10(row.peak || 1))));
      const text = Number.isFinite(value) && row.peak < 1e7 && row.peak >= 1e-3 && !Number.isInteger(row.peak) ? value.toFixed(decimals).replace("-", "−") : number(value);
      const named = signal.names?.get(value) ?? text;
      if (figure.data !== named) figure.data = named;
    }
  }
}

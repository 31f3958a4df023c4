// Parameters: shown to all viewers, set by those with the token.

import { $, make, put } from "./text.js";

export class Parameters {
  constructor(connection) {
    this.connection = connection;
    this.root = $("#parameters");
    this.note = make("p", { class: "muted" });
    this.panel = make("div", { class: "panel" });
    this.root.append(this.note, this.panel);
    this.rows = new Map();
    this.maySet = false;
  }

  authorized(ok) {
    this.maySet = ok;
    for (const row of this.rows.values()) row.allow(ok);
    this.send();
  }

  send() {
    const { hello, token } = this.connection;
    put(this.note, this.maySet ? "" : !hello?.can_set ? "They can be looked at. The scope was started without a token to set them." : token ? "The token is not the one that the scope was started with." : "They can be looked at. To set them, open the address with the token.");
    this.note.hidden = this.note.textContent === "";
  }

  list(list) {
    this.send();
    const names = new Set(list.map(({ name }) => name));
    for (const [name, row] of this.rows) if (!names.has(name)) { row.root.remove(); this.rows.delete(name); }
    for (const parameter of list) {
      let row = this.rows.get(parameter.name);
      if (!row) {
        row = this.row(parameter);
        this.rows.set(parameter.name, row);
        this.panel.append(row.root);
      }
      row.value(parameter.value);
    }
  }

  row({ name, value, unit, description, least, greatest }) {
    const isFlag = typeof value === "boolean", isNumber = typeof value === "number";
    const input = make("input", { type: isFlag ? "checkbox" : isNumber ? "number" : "text", "aria-label": name, step: "any", min: least, max: greatest });
    const button = make("button", {}, "Set"), error = make("p", { class: "error", role: "status" });
    const range = least !== undefined && greatest !== undefined ? ` From ${least} to ${greatest}.` : "";
    const root = make("form", { class: "parameter" }, make("label", {}, name, unit ? make("span", { class: "muted" }, `  ${unit}`) : ""), input, button, make("p", {}, (description && range ? `${description}.` : description) + range), error);
    let shown = value;
    const text = (value) => (typeof value === "string" ? value : JSON.stringify(value));
    const show = () => { if (isFlag) input.checked = shown; else input.value = isNumber ? shown : text(shown); };
    const read = () => {
      if (isFlag) return input.checked;
      if (isNumber) return input.valueAsNumber;
      if (typeof shown === "string") return input.value;
      try { return JSON.parse(input.value); } catch { return input.value; }
    };
    root.onsubmit = async (event) => {
      event.preventDefault();
      button.disabled = true;
      const why = await this.connection.set(name, read());
      put(error, why ?? "");
      button.disabled = !this.maySet;
      if (!why) input.blur();
    };
    const row = {
      root,
      value: (value) => {
        if (JSON.stringify(value) === JSON.stringify(shown) && input.value !== "") return;
        shown = value;
        if (document.activeElement !== input) show();
      },
      allow: (ok) => { input.disabled = button.disabled = !ok; button.hidden = !ok; },
    };
    show();
    row.allow(this.maySet);
    return row;
  }
}

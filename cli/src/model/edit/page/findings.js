// What the check and the bounds say: below the drawing, and as marks in it.

function make(kind, properties = {}, ...children) {
  const element = Object.assign(document.createElement(kind), properties);
  element.append(...children);
  return element;
}

export const count = (value) => value.toString().replace(/\B(?=(\d{3})+$)/g, "\u2009");

const micros = (nanos) => (nanos === null ? "-" : (nanos / 1000).toFixed(1));

/** The part of a scope that a process is or is in: `cell.feeder[1]` is `cell` in the system. */
export function partOf(view, scope, name) {
  let within = null;
  for (const step of name.split(".")) {
    const part = step.split("[")[0];
    if (within === scope.within) return part;
    const of = view.scopes.find((one) => one.within === within)?.parts.find((one) => one.name === part);
    within = of?.process;
  }
  return null;
}

/** Marks of a check: each process of a circle. */
export function circleMarks(view, scope, checked, marks) {
  for (const finding of checked?.findings ?? []) {
    for (const name of finding.circle) {
      const part = partOf(view, scope, name);
      if (part) marks.set(`part ${part}`, { ...marks.get(`part ${part}`), circle: true });
    }
  }
}

/** Marks of bounds: of an array, or of what is in a part, the one with the least slack. */
export function timeMarks(view, scope, times, marks) {
  const least = new Map();
  for (const row of times?.parts ?? []) {
    const part = partOf(view, scope, row.name);
    const before = least.get(part);
    if (part && (!before || (row.slack_ns ?? Infinity) < (before.slack_ns ?? Infinity))) least.set(part, row);
  }
  for (const [part, row] of least) {
    if (row.deadline_ns === null) continue;
    const note = `bound ${micros(row.bound_ns)}, measured ${micros(row.measured_ns)}, slack ${micros(row.slack_ns)} µs: ${row.verdict}`;
    marks.set(`part ${part}`, { ...marks.get(`part ${part}`), note, bad: row.slack_ns !== null && row.slack_ns < 0 });
  }
}

export class Findings {
  constructor(element, choose) {
    this.element = element;
    this.choose = choose;
  }

  show(checked, times) {
    const content = [...this.checked(checked), ...this.times(times)];
    this.element.replaceChildren(...content);
    this.element.hidden = content.length === 0;
  }

  checked(checked) {
    if (!checked) return [];
    const states = count(checked.states), none = checked.findings.length === 0;
    const way = (title, { steps, trace, there }, open) =>
      make("details", { open, className: "finding" },
        make("summary", { textContent: `${title}, after ${count(steps)} steps` }),
        make("ol", {}, ...trace.map((text) => make("li", { textContent: text }))),
        ...(trace.length < steps ? [make("div", { textContent: `and ${count(steps - trace.length)} more` })] : []),
        ...there.map((text) => make("div", { textContent: text })));
    const summary = checked.is_complete
      ? make("p", { textContent: `All ${states} states were looked at.${none ? " No deadlock, no livelock, no broken assertion was found." : ""}` })
      : make("p", { className: "cut", textContent: `The search was cut after ${states} states: ${checked.limit === "memory" ? "there are more than half of the free memory holds" : "there are more; raise their number"}. ${none ? "Nothing was found among these, which proves nothing." : "There may be more to find."}` });
    const findings = checked.findings.map((finding) => way(finding.kind, finding, true));
    if (checked.stuck) findings.push(way(`for ever without ${checked.stuck.processes.join(", ")}`, checked.stuck, false));
    const ltl = checked.ltl.length > 0 ? [make("p", { className: "what", textContent: `Not checked here: ${checked.ltl.join(", ")} (LTL). \`luna model check --spin\` checks them.` })] : [];
    const unreached = checked.unreached.map((one) => {
      const text = `line ${one.line}: in ${one.process} no run takes ${one.what}`;
      return make("div", {}, make("button", { className: "small", textContent: text, onclick: () => this.choose(`process ${one.process}`) }));
    });
    return [summary, ...findings, ...unreached, ...ltl];
  }

  times(times) {
    if (!times) return [];
    const cell = (kind, text) => make(kind, { textContent: text });
    const head = ["part", "on", "period", "cost", "bound", "measured", "deadline", "slack", "verdict"];
    const rows = times.parts.map((row) => {
      const numbers = [row.period_ns, row.cost_ns, row.bound_ns, row.measured_ns, row.deadline_ns, row.slack_ns].map(micros);
      const cells = [row.name, row.executor ?? "-", ...numbers, row.verdict].map((text) => cell("td", text));
      const tr = make("tr", {}, ...cells);
      if (row.advice) tr.title = row.advice;
      return tr;
    });
    const table = make("table", { id: "times-table" }, make("tr", {}, ...head.map((text) => cell("th", text))), ...rows);
    return [make("p", { textContent: "Response times in µs" }), table];
  }
}

// Numbers and elements, as they are shown.

const MOST_MULTIPLES = 1000; // more than an axis has room for

export const $ = (selector, within = document) => within.querySelector(selector);

// An element with attributes and children; text is never taken for HTML.
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") element.className = value;
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

// Short name of a process that is named by its place in the source: its file, and its folder unless that is common.
export function place(name) {
  const found = /(?:^|\/)((?:[^/]+\/)?[^/]+\.rs:\d+.*)$/.exec(name);
  return found ? found[1].replace(/^src\//, "") : name;
}

// Changes the text of an element only if it is another.
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// A time span in its unit, with three figures: [number, unit].
export function spanParts(seconds) {
  const size = Math.abs(seconds);
  if (size === 0) return ["0", "s"];
  for (const [limit, factor, unit] of [[0.9995e-6, 1e9, "ns"], [0.9995e-3, 1e6, "µs"], [0.9995, 1e3, "ms"], [Infinity, 1, "s"]]) {
    if (size < limit) return [figures(seconds * factor), unit];
  }
}
export const span = (seconds) => spanParts(seconds).join(" ");

function figures(value) {
  const size = Math.abs(value);
  const digits = size >= 99.95 ? 0 : size >= 9.995 ? 1 : 2;
  return value.toFixed(digits).replace("-", "−");
}

// A value with about five figures.
export function number(value) {
  if (value !== value) return "–";
  if (!isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  if (Number.isInteger(value) && size < 1e7) return String(value).replace("-", "−");
  if (size !== 0 && (size < 1e-4 || size >= 1e7)) return value.toExponential(3).replace("-", "−");
  const digits = Math.max(0, Math.min(5, 4 - Math.floor(Math.log10(size))));
  return value.toFixed(Math.min(digits, 4)).replace("-", "−");
}

// The names of a signal's values, by its description "0 stopped; 1 running"; null if that is none.
export function namesIn(description) {
  const parts = description.split(";").map((part) => /^\s*(-?\d+)\s+(\S.*?)\s*$/.exec(part));
  return parts.length > 1 && parts.every(Boolean) ? new Map(parts.map(([, value, name]) => [Number(value), name])) : null;
}

// Two values and their difference, with as many digits behind the point as the finer of the two has.
export function alike([a, b, difference]) {
  const texts = [a, b].map(number);
  if (![a, b].every(isFinite) || texts.some((text) => text.includes("e"))) return [...texts, number(difference)];
  const digits = Math.max(...texts.map((text) => text.split(".")[1]?.length ?? 0));
  return [a, b, difference].map((value) => value.toFixed(digits).replace("-", "−"));
}

export const count = (value) => Math.round(value).toString().replace(/\B(?=(\d{3})+$)/g, "\u2009");

// An instant since the recording began, as fine as it is looked at.
export function instant(seconds, step = 0.001) {
  const digits = Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)));
  return seconds.toFixed(digits).replace("-", "−") + " s";
}

// The multiples of a step between two values, however fine the step is beside them.
export function multiples(each, from, to) {
  const first = Math.ceil(from / each), number = Math.min(MOST_MULTIPLES, Math.floor(to / each) - first + 1);
  return Array.from({ length: number > 0 ? number : 0 }, (_, n) => (first + n) * each);
}

// Round steps for an axis: at most `most` of them between two values.
export function step(from, to, most) {
  const rough = (to - from) / Math.max(1, most);
  const power = 10 ** Math.floor(Math.log10(rough));
  for (const factor of [1, 2, 5, 10]) if (factor * power >= rough) return factor * power;
}

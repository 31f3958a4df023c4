// A picture of the machine: an SVG of the program, in which elements follow signals, processes and channels (docs/scope-pictures.md). Of the SVG only elements and attributes that are listed here are taken, so that nothing in it runs or loads anything.

import { $, make, put, number } from "./text.js";
import { Drawing } from "./drawing.js";

const SVG = "http://www.w3.org/2000/svg";
const MOST_ELEMENTS = 5000, DEEPEST = 64;
const LEAST_SCALE = 0.75; // of a drawing
const ELEMENTS = new Set(["svg", "g", "path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "text", "tspan", "title", "desc"]);
const PRESENTATION = new Set(["fill", "fill-opacity", "fill-rule", "stroke", "stroke-width", "stroke-opacity", "stroke-linecap", "stroke-linejoin", "stroke-dasharray", "stroke-dashoffset", "opacity", "font-size", "font-style", "font-weight", "text-anchor", "dominant-baseline", "display", "paint-order"]);
const GEOMETRY = new Set(["viewBox", "preserveAspectRatio", "transform", "x", "y", "dx", "dy", "x1", "y1", "x2", "y2", "cx", "cy", "r", "rx", "ry", "width", "height", "d", "points"]);
// No quotes, slashes, colons or escapes, and no reference.
const isPlain = (value) => /^[-\w\s.,;#%()+]*$/.test(value) && !/url/i.test(value);

// What a bound element changes, by the attribute that has its table. Numbers are linear between the entries, the others hold from entry to entry.
const MOVES = ["x", "y", "turn"];
const SIZES = { width: "width", height: "height", dash: "stroke-dashoffset", opacity: "opacity" };
const STEPS = ["fill", "stroke", "text", "show"];
const SILENT = "silent";
const DRAWN = new Set(["ground", "texts", "g", "p", "a", "small", "label"]); // parts of the drawing of a model

class Problem extends Error {}

// "0 stopped; 4 fault; silent lost" as [[0, "stopped"], [4, "fault"]] and what holds in silence.
function table(name, text, isNumeric) {
  const entries = [];
  let silent;
  for (const one of text.split(";").map((part) => part.trim()).filter(Boolean)) {
    const [, key, rest] = /^(\S+)\s+(.*)$/.exec(one) ?? [];
    const from = Number(key), result = isNumeric ? Number(rest) : rest;
    if (key === undefined || (isNumeric && !isFinite(result))) throw new Problem(`data-${name}="${text}": ${one}`);
    if (key === SILENT && !isNumeric) silent = result;
    else if (isFinite(from) && (entries.length === 0 || from > entries.at(-1)[0])) entries.push([from, result]);
    else throw new Problem(`data-${name}="${text}": ${one}`);
  }
  if (entries.length === 0 && silent === undefined && name !== "text") throw new Problem(`data-${name}="${text}"`);
  return { entries, silent };
}

function linear({ entries }, value) {
  const next = entries.findIndex(([from]) => from > value);
  if (next < 0) return entries.at(-1)[1];
  if (next === 0) return entries[0][1];
  const [[a, x], [b, y]] = [entries[next - 1], entries[next]];
  return x + ((value - a) / (b - a)) * (y - x);
}

const step = ({ entries }, value) => entries.findLast(([from]) => from <= value)?.[1];

// An element that follows a signal.
class Part {
  constructor(element, data) {
    this.element = element;
    this.signal = data.signal;
    this.repeat = this.amount(data, "repeat");
    this.silence = this.amount(data, "silent") ?? Infinity;
    this.digits = this.amount(data, "digits");
    this.tables = new Map();
    for (const name of [...MOVES, ...Object.keys(SIZES), ...STEPS]) {
      if (data[name] === undefined) continue;
      const isNumeric = !STEPS.includes(name), found = table(name, data[name], isNumeric);
      if ((name === "fill" || name === "stroke") && ![...found.entries.map(([, colour]) => colour), found.silent ?? ""].every(isPlain)) throw new Problem(`data-${name}="${data[name]}"`);
      this.tables.set(name, found);
    }
    this.moves = MOVES.some((name) => this.tables.has(name));
    this.needsValue = this.moves || Object.keys(SIZES).some((name) => this.tables.has(name));
    this.transform = element.getAttribute("transform") ?? "";
    this.own = {}; // the attributes as they were
    this.now = {};
  }

  amount(data, name) {
    if (data[name] === undefined) return undefined;
    const value = Number(data[name]);
    if (data[name].trim() === "" || !(value >= 0) || (name === "digits" && value > 20)) throw new Problem(`data-${name}="${data[name]}"`);
    return value;
  }

  // Without a value, the element is as it was.
  set(attribute, value) {
    if (!(attribute in this.own)) this.own[attribute] = this.element.getAttribute(attribute);
    const wanted = value ?? this.own[attribute];
    if (this.now[attribute] === wanted) return;
    this.now[attribute] = wanted;
    if (wanted === null) this.element.removeAttribute(attribute);
    else this.element.setAttribute(attribute, wanted);
  }

  draw(curve, now) {
    const series = curve?.signal.series, at = series ? series.before(now) : -1;
    let value = at < 0 ? NaN : series.value(at, curve.element);
    const isSilent = at >= 0 && now - series.time(at) > this.silence;
    const shown = value;
    if (this.repeat > 0) value -= Math.floor(value / this.repeat) * this.repeat;
    const isKnown = value === value;
    const is = (name) => { const one = this.tables.get(name); return isSilent && one.silent !== undefined ? one.silent : isKnown ? step(one, value) : undefined; };
    const show = this.tables.has("show") ? is("show") === "yes" : true;
    this.set("display", show && (isKnown || !this.needsValue) ? null : "none");
    for (const name of ["fill", "stroke"]) if (this.tables.has(name)) this.set(name, is(name));
    if (this.tables.has("text")) {
      const words = is("text");
      put(this.element, words ?? this.figure(shown, curve));
    }
    if (!isKnown) return;
    const by = (name) => (this.tables.has(name) ? linear(this.tables.get(name), value) : 0).toFixed(2);
    for (const [name, attribute] of Object.entries(SIZES)) if (this.tables.has(name)) this.set(attribute, by(name));
    if (this.moves) this.set("transform", `${this.transform} translate(${by("x")} ${by("y")}) rotate(${by("turn")})`.trim());
  }

  figure(value, curve) {
    if (value !== value) return "–";
    const text = this.digits === undefined || Math.abs(value) >= 1e7 ? number(value) : value.toFixed(this.digits).replace("-", "−");
    return curve.signal.unit ? `${text} ${curve.signal.unit}` : text;
  }
}

export class Picture {
  constructor(model, clock) {
    Object.assign(this, { model, clock });
    this.root = $("#picture");
    this.notes = make("p", { class: "note", role: "status", hidden: true });
    this.place = make("div", { class: "machine" });
    this.drawing = new Drawing(model, clock);
    this.root.append(this.drawing.tools, this.place, this.notes);
    this.parts = [];
    this.problems = [];
  }

  // Takes the program's SVG, if it has one. Returns whether there is a picture.
  load(text) {
    if (text === this.text) return Boolean(text);
    this.text = text;
    this.parts = [];
    this.drawing.reset();
    this.problems = [];
    this.version = -1;
    this.place.replaceChildren();
    if (!text) return false;
    // The drawing of a model has the page's colours, and its style sheet would be refused as it is read.
    const dark = /<style id="dark">[^<]*<\/style>/;
    this.isDrawing = dark.test(text);
    const source = new DOMParser().parseFromString(text.replace(dark, ""), "image/svg+xml").documentElement;
    if (source.localName !== "svg" || source.namespaceURI !== SVG || source.querySelector("parsererror")) {
      this.problems.push("The picture is no SVG that can be read.");
      return true;
    }
    this.left = MOST_ELEMENTS;
    this.dropped = new Set();
    const svg = this.copy(source, 0);
    // As large as there is room, with its own proportions.
    const [width, height] = ["width", "height"].map((name) => parseFloat(svg.getAttribute(name)));
    if (!svg.hasAttribute("viewBox") && width > 0 && height > 0) svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    for (const name of ["width", "height"]) svg.removeAttribute(name);
    // The text of a large drawing stays readable: it is scrolled then.
    if (this.drawing.followers.length > 0 && width > 0 && height > 0) Object.assign(svg.style, { minWidth: `${width * LEAST_SCALE}px`, minHeight: `${height * LEAST_SCALE}px` });
    svg.setAttribute("role", "img");
    this.place.append(svg);
    if (this.dropped.size > 0) this.problems.push(`Left out of the picture: ${[...this.dropped].join(", ")}.`);
    return true;
  }

  copy(source, depth) {
    const element = document.createElementNS(SVG, source.localName), data = {};
    const take = (name, value, isKnown) => {
      if (isKnown && isPlain(value)) element.setAttribute(name, value);
      else if (isKnown) this.dropped.add(`${name}="${value}"`);
    };
    for (const { name, value, namespaceURI } of source.attributes) {
      if (name.startsWith("data-")) data[name.slice(5)] = value;
      else if (/^on/i.test(name) || name === "href" || name === "xlink:href") this.dropped.add(name);
      else if (name === "class" && this.isDrawing && DRAWN.has(value)) element.dataset.drawn = value;
      else if (namespaceURI === null && name !== "style") take(name, value, GEOMETRY.has(name) || PRESENTATION.has(name));
    }
    // As drawing programs write it.
    for (const declaration of (source.getAttribute("style") ?? "").split(";")) {
      const [name, value] = declaration.split(":").map((part) => part.trim());
      if (value !== undefined) take(name, value, PRESENTATION.has(name));
    }
    for (const child of source.childNodes) {
      if (child.nodeType === Node.TEXT_NODE) element.append(child.data);
      if (child.nodeType !== Node.ELEMENT_NODE || (this.isDrawing && child.id === "dark")) continue;
      const isKnown = child.namespaceURI === SVG && ELEMENTS.has(child.localName);
      if (isKnown && depth < DEEPEST && this.left-- > 0) element.append(this.copy(child, depth + 1));
      else if (isKnown) this.dropped.add("more than there is room for");
      else if (child.namespaceURI === SVG) this.dropped.add(`<${child.localName}>`);
    }
    if (data.signal !== undefined) {
      try { this.parts.push(new Part(element, data)); } catch (error) {
        if (!(error instanceof Problem)) throw error;
        this.problems.push(`Not understood: ${error.message}.`);
      }
    } else this.drawing.bind(element, data);
    return element;
  }

  // The signals by their names, and what is wrong with the picture.
  declare() {
    this.version = this.model.version;
    this.curves = new Map();
    for (const signal of this.model.signals.values()) {
      for (let element = 0; element < signal.elements; element++) this.curves.set(signal.elements > 1 ? `${signal.name}[${element}]` : signal.name, { signal, element });
    }
    // Of several programs, a name without that of the program is enough if one program alone has it.
    const missing = new Set(this.parts.map(({ signal }) => signal).filter((name) => !this.curves.has(name)));
    for (const name of missing) {
      const found = [...this.curves].filter(([full]) => full.endsWith(`/${name}`));
      if (found.length !== 1) continue;
      this.curves.set(name, found[0][1]);
      missing.delete(name);
    }
    const notes = [...this.problems, ...this.drawing.declare()];
    if (missing.size > 0 && this.curves.size > 0) notes.push(`Not recorded: ${[...missing].join(", ")}.`);
    put(this.notes, notes.join(" "));
    this.notes.hidden = notes.length === 0;
  }

  frame(now) {
    if (this.version !== this.model.version) this.declare();
    for (const part of this.parts) part.draw(this.curves.get(part.signal), this.clock.now);
    this.drawing.frame(now);
  }

  key(key) {
    if (key === "ArrowLeft") this.drawing.step(-1);
    if (key === "ArrowRight") this.drawing.step(1);
  }
}

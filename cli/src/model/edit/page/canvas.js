// The drawing: boxes, their ports and the lines between them; pan, zoom and drag. While a box is
// dragged, a frame changes this box and its own lines, and nothing else.

import { pointAt, placeLabel, way } from "./ways.js";
import { canMeet, connected } from "./wires.js";

const SVG = "http://www.w3.org/2000/svg";
const GRID = 4;

function make(kind, attributes = {}, text) {
  const element = document.createElementNS(SVG, kind);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

export class Canvas {
  /** `on` has choose(id), moved(name, x, y), joined(a, b), remove(), open(). */
  constructor(svg, on) {
    this.svg = svg;
    this.on = on;
    this.world = svg.querySelector("#world");
    this.boxesGroup = svg.querySelector("#boxes");
    this.wiresGroup = svg.querySelector("#wires");
    this.rubber = svg.querySelector("#rubber");
    this.boxes = new Map();
    this.wires = new Map();
    this.at = { x: 40, y: 30, scale: 1 };
    /** How many elements the last frame of a drag changed. */
    this.work = 0;
    this.drag = null;
    svg.addEventListener("pointerdown", (event) => this.down(event));
    svg.addEventListener("pointermove", (event) => this.move(event));
    svg.addEventListener("pointerup", (event) => this.up(event));
    svg.addEventListener("pointercancel", () => this.end());
    svg.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    svg.addEventListener("keydown", (event) => this.key(event));
    svg.addEventListener("keyup", (event) => this.keyUp(event));
    svg.addEventListener("dblclick", (event) => event.target.closest(".box") && this.on.open());
    svg.addEventListener("focusin", (event) => {
      const id = event.target.closest("[data-id]")?.dataset.id;
      if (id && id !== this.chosen && !this.isDrawing) this.on.choose(id);
    });
  }

  /** Draws a scope anew. */
  draw(scope, processes) {
    const focused = document.activeElement?.closest?.("#canvas [data-id]")?.dataset.id;
    this.boxes.clear();
    this.wires.clear();
    this.boxesGroup.replaceChildren();
    this.wiresGroup.replaceChildren();
    const known = new Map(processes.map((process) => [process.name, process]));
    for (const part of scope.parts) this.part(part, known.get(part.process));
    this.terminals(scope);
    for (const wire of connected(scope, processes)) this.wire(wire);
    for (const wire of this.wires.values()) this.place(wire);
    this.spread();
    this.choose(this.chosen);
    // The focus comes back, and chooses nothing.
    this.isDrawing = true;
    if (focused) this.svg.querySelector(`[data-id="${CSS.escape(focused)}"]`)?.focus({ preventScroll: true });
    this.isDrawing = false;
  }

  part(part, process) {
    const [x, y, width, height] = part.area;
    const title = part.array ? `${part.name}[${part.array}]` : part.name;
    const box = this.box(`part ${part.name}`, { x, y, width, height }, title, part.process);
    box.name = part.name;
    box.g.classList.toggle("is-composed", Boolean(process) && process.body === null);
    for (const side of ["receive", "send"]) {
      const ports = (process?.ports ?? []).filter(([, is]) => is === side);
      ports.forEach(([port], number) => {
        const px = ((number + 1) * width) / (ports.length + 1);
        const py = side === "send" ? height : 0;
        this.port(box, port, side, px, py, part.bind.some(([name]) => name === port));
      });
    }
  }

  /** The ports of the process that is shown: above and below its parts. */
  terminals(scope) {
    const areas = scope.parts.map((part) => part.area);
    const top = Math.min(0, ...areas.map(([, y]) => y)) - 90;
    const bottom = Math.max(0, ...areas.map(([, y, , height]) => y + height)) + 50;
    const count = { send: 0, receive: 0 };
    for (const [name, side] of scope.ports) {
      const width = name.length * 8 + 24;
      const x = count[side]++ * 140;
      const box = this.box(`port ${name}`, { x, y: side === "send" ? bottom : top, width, height: 28 }, name, "");
      box.g.classList.add("terminal");
      this.port(box, name, side, width / 2, side === "send" ? 0 : 28, true);
    }
  }

  box(id, area, title, what) {
    const { x, y, width, height } = area;
    const g = make("g", { class: "box", "data-id": id, tabindex: 0, role: "button", transform: `translate(${x} ${y})`, "aria-label": `${title} ${what}` });
    g.append(make("rect", { width, height, rx: 6 }), make("text", { x: width / 2, y: what ? 24 : 18 }, title));
    if (what) g.append(make("text", { x: width / 2, y: 41, class: "what" }, what));
    const note = make("text", { x: width / 2, y: height + 22, class: "note" });
    g.append(note);
    this.boxesGroup.append(g);
    const box = { id, g, note, x, y, width, height, ports: new Map(), lines: [] };
    this.boxes.set(id, box);
    return box;
  }

  port(box, port, side, x, y, isBound) {
    const circle = make("circle", { class: `port ${side}${isBound ? " is-bound" : ""}`, cx: x, cy: y, r: 5.5, "data-box": box.id, "data-port": port, "data-side": side });
    circle.append(make("title", {}, `${port}: ${side}`));
    const name = make("text", { class: "port-name", x: x + 8, y: side === "send" ? y + 12 : y - 7 }, port);
    box.g.append(circle, name);
    box.ports.set(port, { x, y });
  }

  wire({ channel, name, send, receive }) {
    if (!channel && !(send.length && receive.length)) return;
    const holds = channel?.keys.find(([key]) => key === "buffer")?.[1];
    const array = channel?.keys.find(([key]) => key === "array")?.[1];
    const held = holds ? ` (${holds})` : "";
    const label = `${name}${array ? `[${array}]` : ""}${held}`;
    const pairs = send.flatMap((from) => receive.filter((to) => canMeet(from, to)).map((to) => [from, to]));
    const open = pairs.length ? [] : [...send.map((from) => [from, null]), ...receive.map((to) => [null, to])];
    const all = [...pairs, ...open];
    all.forEach(([from, to], number) => {
      const id = `channel ${name}`;
      const g = make("g", { class: `wire${from && to ? "" : " is-open"}`, "data-id": channel ? id : `port ${name}` });
      if (number === 0) g.setAttribute("tabindex", 0);
      const path = make("path");
      // Beside each other, if they have the same ends.
      const element = from?.element ?? to?.element ?? null;
      const own = element === null ? label : `${name}[${element}]${held}`;
      const text = make("text", {}, number === 0 || all.length < 4 || element !== null ? own : "");
      g.append(path, text);
      this.wiresGroup.append(g);
      const wire = { id, g, path, text, from, to, number: this.wires.size };
      this.wires.set(`${id} ${number}`, wire);
      for (const end of [from, to]) if (end) this.boxes.get(end.box)?.lines.push(wire);
    });
  }

  /** Labels stand apart from boxes and from each other. */
  spread() {
    const taken = [...this.boxes.values()].map(({ x, y, width, height }) => ({ x, y, width, height }));
    for (const wire of this.wires.values()) {
      const text = wire.text.textContent;
      if (text) wire.label = placeLabel(text, wire.points, taken);
      this.place(wire, false);
    }
  }

  /** Where a port is. */
  spot({ box, port }) {
    const found = this.boxes.get(box);
    const at = found?.ports.get(port) ?? { x: 0, y: 0 };
    return found ? [found.x + at.x, found.y + at.y] : [0, 0];
  }

  place(wire, anew = true) {
    const { path, text, from, to, number, label } = wire;
    if (anew) {
      const start = from ? this.spot(from) : null, end = to ? this.spot(to) : null;
      const own = [from, to].map((port) => port && this.boxes.get(port.box));
      // While a box is dragged its lines are curves.
      const boxes = this.drag || this.nudged ? [] : [...this.boxes.values()];
      const { d, points } = way(start ?? [end[0], end[1] - 34], end ?? [start[0], start[1] + 34], boxes, own, number);
      path.setAttribute("d", d);
      wire.points = points;
    }
    const [x, y] = pointAt(wire.points, label?.share ?? 0.5);
    text.setAttribute("x", x + (label?.by ?? 0));
    text.setAttribute("y", y);
  }

  choose(id) {
    this.chosen = id;
    for (const one of this.svg.querySelectorAll(".is-chosen")) one.classList.remove("is-chosen");
    for (const one of this.svg.querySelectorAll(`[data-id="${CSS.escape(id ?? "")}"]`)) one.classList.add("is-chosen");
  }

  /** Marks boxes and channels by their ids: `{kind: "circle" | "wrong", note, bad}`. */
  mark(marks) {
    for (const [id, box] of this.boxes) {
      const mark = marks.get(id);
      box.g.classList.toggle("is-circle", Boolean(mark?.circle));
      box.g.classList.toggle("is-wrong", Boolean(mark?.wrong));
      box.note.textContent = mark?.note ?? "";
      box.note.classList.toggle("bad", Boolean(mark?.bad));
    }
    for (const wire of this.wires.values()) wire.g.classList.toggle("is-wrong", Boolean(marks.get(wire.id)?.wrong));
  }

  /** All in the window. */
  whole() {
    const boxes = [...this.boxes.values()];
    const size = this.svg.getBoundingClientRect();
    const [left, top] = [Math.min(...boxes.map((b) => b.x)), Math.min(...boxes.map((b) => b.y))];
    const [right, bottom] = [Math.max(...boxes.map((b) => b.x + b.width)), Math.max(...boxes.map((b) => b.y + b.height))];
    if (!boxes.length || !size.width) return;
    const scale = Math.min(1.2, (size.width - 80) / (right - left), (size.height - 80) / (bottom - top));
    this.at = { scale, x: (size.width - (right + left) * scale) / 2, y: (size.height - (bottom + top) * scale) / 2 };
    this.look();
  }

  look() {
    this.world.setAttribute("transform", `translate(${this.at.x} ${this.at.y}) scale(${this.at.scale})`);
  }

  /** A point of the window in the drawing. */
  inside(event) {
    const area = this.svg.getBoundingClientRect();
    return [(event.clientX - area.x - this.at.x) / this.at.scale, (event.clientY - area.y - this.at.y) / this.at.scale];
  }

  center() {
    const area = this.svg.getBoundingClientRect();
    return this.inside({ clientX: area.x + area.width / 2, clientY: area.y + area.height / 2 }).map((n) => Math.round(n / GRID) * GRID);
  }

  zoom(factor, x, y) {
    const scale = Math.min(4, Math.max(0.05, this.at.scale * factor));
    const by = scale / this.at.scale;
    this.at = { scale, x: x - (x - this.at.x) * by, y: y - (y - this.at.y) * by };
    this.look();
  }

  wheel(event) {
    event.preventDefault();
    const area = this.svg.getBoundingClientRect();
    this.zoom(Math.exp(-event.deltaY / 500), event.clientX - area.x, event.clientY - area.y);
  }

  down(event) {
    if (event.button !== 0) return;
    const port = event.target.closest(".port");
    const element = event.target.closest("[data-id]");
    const box = this.boxes.get(element?.dataset.id);
    const [x, y] = this.inside(event);
    if (port) this.drag = { kind: "join", from: { ...port.dataset } };
    else if (box?.name) this.drag = { kind: "move", box, dx: box.x - x, dy: box.y - y, x: box.x, y: box.y };
    else if (!element) this.drag = { kind: "pan", x: event.clientX - this.at.x, y: event.clientY - this.at.y };
    if (!port) this.on.choose(element?.dataset.id ?? null);
    if (this.drag) this.svg.setPointerCapture(event.pointerId);
  }

  move(event) {
    if (!this.drag) return;
    this.drag.last = event;
    this.drag.frame ??= requestAnimationFrame(() => this.frame());
  }

  /** One frame of a drag, with the pointer's last place. */
  frame() {
    if (!this.drag?.last) return;
    const { drag } = this;
    drag.frame = null;
    const [x, y] = this.inside(drag.last);
    if (drag.kind === "pan") {
      this.at.x = drag.last.clientX - drag.x;
      this.at.y = drag.last.clientY - drag.y;
      this.look();
      this.work = 1;
    } else if (drag.kind === "move") {
      this.put(drag.box, Math.round((x + drag.dx) / GRID) * GRID, Math.round((y + drag.dy) / GRID) * GRID);
    } else {
      const [fx, fy] = this.spot({ box: drag.from.box, port: drag.from.port });
      this.rubber.removeAttribute("hidden");
      this.rubber.setAttribute("d", `M${fx} ${fy}L${x} ${y}`);
      this.work = 1;
    }
  }

  /** Moves a box with its lines. */
  put(box, x, y) {
    box.x = x;
    box.y = y;
    box.g.setAttribute("transform", `translate(${x} ${y})`);
    for (const wire of box.lines) this.place(wire);
    this.work = 1 + 2 * box.lines.length;
  }

  up(event) {
    const { drag } = this;
    if (!drag) return;
    if (drag.last) {
      drag.last = event;
      this.frame();
    }
    this.end();
    if (drag.kind === "move" && (drag.box.x !== drag.x || drag.box.y !== drag.y)) this.on.moved(drag.box.name, drag.box.x, drag.box.y);
    if (drag.kind === "join") {
      const to = document.elementFromPoint(event.clientX, event.clientY)?.closest(".port");
      if (to) this.on.joined({ ...drag.from }, { ...to.dataset });
    }
  }

  end() {
    if (this.drag?.frame) cancelAnimationFrame(this.drag.frame);
    this.drag = null;
    this.rubber.setAttribute("hidden", "");
  }

  key(event) {
    const area = this.svg.getBoundingClientRect();
    const step = event.shiftKey ? 40 : 8;
    const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    const box = this.boxes.get(this.chosen);
    if (by && box?.name && event.target.closest(".box")) {
      this.nudged = box;
      this.put(box, box.x + by[0], box.y + by[1]);
    } else if (by) {
      this.at.x -= by[0] * 4;
      this.at.y -= by[1] * 4;
      this.look();
    } else if (event.key === "+" || event.key === "-") this.zoom(event.key === "+" ? 1.25 : 0.8, area.width / 2, area.height / 2);
    else if (event.key === "0") this.whole();
    else if (event.key === "Delete") this.on.remove();
    else if (event.key === "Enter") document.querySelector("#panel input, #panel select")?.focus();
    else if (event.key === "Escape") this.on.choose(null);
    else return;
    event.preventDefault();
  }

  keyUp(event) {
    if (!this.nudged || !event.key.startsWith("Arrow")) return;
    const { name, x, y } = this.nudged;
    this.nudged = null;
    this.on.moved(name, x, y);
  }
}



// The graph of processes and channels: places of the boxes, and lines between them. Values flow down, as far as there are no cycles.

const SVG = "http://www.w3.org/2000/svg";
const WIDEST = 190, NARROWEST = 136, HIGH = 50, APART = 48, BESIDE = 14; // pixels
const BEND = 26; // what a line needs that passes by boxes
const MOST_LINES = 64; // of one channel
const SWEEPS = 6;

function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

// Lines [from, to, channel] between processes.
function linesOf(channels, boxes) {
  const lines = [];
  for (const { number, from, to } of channels) {
    let room = MOST_LINES;
    for (const a of from) for (const b of to) if (a !== b && boxes.has(a) && boxes.has(b) && room-- > 0) lines.push({ from: a, to: b, channel: number });
  }
  return lines;
}

// The layer of each process: below all that send to it, but for lines that close a cycle, which are turned around.
function layersOf(numbers, lines) {
  const out = new Map(numbers.map((number) => [number, []])), inside = new Map(numbers.map((number) => [number, 0]));
  for (const line of lines) { out.get(line.from).push(line); inside.set(line.to, inside.get(line.to) + 1); }
  const state = new Map();
  const visit = (number) => {
    // Without recursion: a chain may be long.
    const stack = [[number, 0]];
    state.set(number, 1);
    while (stack.length > 0) {
      const top = stack.at(-1), line = out.get(top[0])[top[1]++];
      if (!line) { state.set(top[0], 2); stack.pop(); continue; }
      const other = state.get(line.to);
      line.back = other === 1;
      if (other === undefined) { state.set(line.to, 1); stack.push([line.to, 0]); }
    }
  };
  // From where nothing comes in, first.
  for (const number of [...numbers].sort((a, b) => inside.get(a) - inside.get(b) || a - b)) if (!state.has(number)) visit(number);
  const layer = new Map(numbers.map((number) => [number, 0]));
  const ends = ({ from, to, back }) => (back ? [to, from] : [from, to]);
  for (let changed = true, turns = 0; changed && turns <= numbers.length; turns++) {
    changed = false;
    for (const line of lines) {
      const [upper, lower] = ends(line);
      if (layer.get(lower) <= layer.get(upper)) { layer.set(lower, layer.get(upper) + 1); changed = true; }
    }
  }
  // What only sends stands right above what it sends to.
  for (const number of numbers) {
    const below = lines.filter((line) => ends(line)[0] === number).map((line) => layer.get(ends(line)[1]));
    if (below.length > 0 && !lines.some((line) => ends(line)[1] === number)) layer.set(number, Math.min(...below) - 1);
  }
  // Without empty layers.
  const order = [...new Set(layer.values())].sort((a, b) => a - b);
  for (const [number, at] of layer) layer.set(number, order.indexOf(at));
  return { layer, ends };
}

// Gives places to the boxes, within a width if they can be made narrow enough: { width, height, at: by number { x, y, wide }, lines with their points }.
export function layout(boxes, channels, room) {
  const all = [...channels];
  for (let wide = WIDEST; ; wide -= 9) {
    const found = withBoxes(boxes, all, room, wide);
    if (found.width <= room || wide - 9 < NARROWEST) return found;
  }
}

function withBoxes(boxes, channels, room, wide) {
  const lines = linesOf(channels, boxes), linked = new Set(lines.flatMap(({ from, to }) => [from, to]));
  const numbers = [...boxes.keys()].filter((number) => linked.has(number)).sort((a, b) => a - b);
  const { layer, ends } = layersOf(numbers, lines);
  const rows = [];
  const node = (row, extra) => {
    const one = { x: 0, wide, up: [], down: [], ...extra };
    (rows[row] ??= []).push(one);
    return one;
  };
  const nodes = new Map(numbers.map((number) => [number, node(layer.get(number), { number })]));
  const link = (a, b) => { a.down.push(b); b.up.push(a); };
  for (const line of lines) {
    const [upper, lower] = ends(line);
    line.way = [nodes.get(upper)];
    // A line that passes a row has a place in it.
    for (let row = layer.get(upper) + 1; row < layer.get(lower); row++) line.way.push(node(row, { wide: BEND - BESIDE }));
    line.way.push(nodes.get(lower));
    for (let n = 1; n < line.way.length; n++) link(line.way[n - 1], line.way[n]);
  }
  const mean = (list, of) => list.reduce((sum, one) => sum + of(one), 0) / list.length;
  rows.forEach((row) => row.forEach((one, n) => { one.x = n * (wide + BESIDE); }));
  const place = (row, side) => {
    for (const one of row) one.wish = one[side].length > 0 ? mean(one[side], ({ x }) => x) : one.x;
    row.sort((a, b) => a.wish - b.wish || (a.number ?? 0) - (b.number ?? 0));
    // Next to each other, in groups that stand where they wish to be on average.
    const groups = [];
    for (const one of row) {
      let group = { members: [one], wishes: [one.wish], span: one.wide };
      while (groups.length > 0) {
        const before = groups.at(-1), end = mean(before.wishes, (x) => x) + before.span / 2;
        if (end + BESIDE <= mean(group.wishes, (x) => x) - group.span / 2) break;
        groups.pop();
        group = { members: [...before.members, ...group.members], wishes: [...before.wishes, ...group.wishes], span: before.span + BESIDE + group.span };
      }
      groups.push(group);
    }
    for (const { members, wishes, span } of groups) {
      let left = mean(wishes, (x) => x) - span / 2;
      for (const one of members) { one.x = left + one.wide / 2; left += one.wide + BESIDE; }
    }
  };
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    for (let n = 1; n < rows.length; n++) place(rows[n], "up");
    for (let n = rows.length - 2; n >= 0; n--) place(rows[n], "down");
  }
  const all = rows.flat();
  const least = Math.min(...all.map(({ x, wide }) => x - wide / 2)), most = Math.max(...all.map(({ x, wide }) => x + wide / 2));
  const width = all.length === 0 ? 0 : most - least, shift = Math.max(0, room - width) / 2 - least;
  rows.forEach((row, n) => row.forEach((one) => { one.x += shift; one.y = n * (HIGH + APART); }));
  // Those without a channel stand below.
  const at = new Map();
  for (const [number, one] of nodes) at.set(number, { x: one.x - wide / 2, y: one.y, wide });
  const each = Math.max(1, Math.floor((Math.max(room, width) + BESIDE) / (wide + BESIDE)));
  const alone = [...boxes.keys()].filter((number) => !linked.has(number)).sort((a, b) => a - b);
  const below = rows.length * (HIGH + APART);
  alone.forEach((number, n) => at.set(number, { x: (n % each) * (wide + BESIDE), y: below + Math.floor(n / each) * (HIGH + BESIDE), wide }));
  const height = below + (alone.length > 0 ? Math.ceil(alone.length / each) * (HIGH + BESIDE) : -APART);
  return { width: Math.max(room, width), height: Math.max(0, height), at, lines };
}

// A place for a label beside a line where there is none yet, if there is one.
function free(taken, way, text) {
  const wide = text.length * 6.1;
  for (let n = 1; n < way.length; n++) {
    const [a, b] = [way[n - 1], way[n]];
    for (const part of [0.5, 0.78, 0.24]) {
      // As the line bends.
      const bend = part * part * (3 - 2 * part), x = a.x + (b.x - a.x) * bend + 5, y = a.y + HIGH + APART * part;
      const box = [x, y - 7, x + wide, y + 7];
      if (taken.some(([left, top, right, bottom]) => box[0] < right + 4 && left < box[2] + 4 && box[1] < bottom && top < box[3])) continue;
      taken.push(box);
      return { x, y };
    }
  }
  return {};
}

// Draws the lines. Returns the group of each.
export function draw(root, { width, height, lines }, nameOf, mark) {
  root.setAttribute("width", width);
  root.setAttribute("height", height);
  root.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const taken = []; // by labels: [left, top, right, bottom]
  const drawn = lines.map((line) => {
    const { way, back, channel } = line;
    let path = "";
    for (let n = 1; n < way.length; n++) {
      const [a, b] = [way[n - 1], way[n]];
      const top = a.y + HIGH, half = (b.y - top) / 2;
      // Past the boxes of a row it goes straight down.
      path += n === 1 ? `M${a.x},${top}` : `L${a.x},${top}`;
      path += `C${a.x},${top + half} ${b.x},${top + half} ${b.x},${b.y}`;
    }
    const [first, last] = [way[0], way.at(-1)];
    const head = back ? `M${first.x - 4},${first.y + HIGH + 7}h8l-4,-7z` : `M${last.x - 4},${last.y - 7}h8l-4,7z`;
    const label = svg("text", free(taken, way, nameOf(channel)));
    label.textContent = label.hasAttribute("x") ? nameOf(channel) : "";
    const group = svg("g", { class: back ? "line back" : "line" }, svg("path", { class: "hit", d: path }), svg("path", { class: "way", d: path }), svg("path", { class: "head", d: head }), label);
    const title = svg("title");
    title.textContent = nameOf(channel);
    group.append(title);
    group.addEventListener("click", () => mark(channel));
    return { ...line, group };
  });
  root.replaceChildren(...drawn.map(({ group }) => group));
  return drawn;
}

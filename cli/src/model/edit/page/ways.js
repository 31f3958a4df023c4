// Ways of lines around boxes, and places of their labels: as `luna model draw` has them.

const APART = 4, STUB = 12, CORNER = 9, MORE = 3.5, OTHERS = 5, MOST = 40, PIECES = 12, ROUND = 10;
const SHARES = [0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82, 0.1, 0.9];
const LETTER = 6.2, ABOVE = 10, HIGH = 14;

function meets({ x, y, width, height }, points) {
  const left = x - APART, top = y - APART, right = x + width + APART, bottom = y + height + APART;
  return points.some(([x2, y2], n) => {
    if (n === 0) return false;
    const [x1, y1] = points[n - 1];
    if (Math.max(x1, x2) <= left || Math.min(x1, x2) >= right || Math.max(y1, y2) <= top || Math.min(y1, y2) >= bottom) return false;
    const sides = [[left, top], [right, top], [left, bottom], [right, bottom]].map(([a, b]) => (x2 - x1) * (b - y1) - (y2 - y1) * (a - x1));
    return !(sides.every((side) => side >= 0) || sides.every((side) => side <= 0));
  });
}

/** The shortest way over corners of obstacles; null if there is none. */
function shortest(obstacles, from, to, corner) {
  const points = [from, to];
  for (const { x, y, width, height } of obstacles) {
    for (const px of [x - corner, x + width + corner]) for (const py of [y - corner, y + height + corner]) points.push([px, py]);
  }
  const length = points.map(() => Infinity), before = [], open = new Set(points.keys());
  length[0] = 0;
  while (open.size > 0) {
    let here = -1;
    for (const one of open) if (here < 0 || length[one] < length[here]) here = one;
    if (length[here] === Infinity) return null;
    if (here === 1) break;
    open.delete(here);
    for (const there of open) {
      const through = length[here] + Math.hypot(points[here][0] - points[there][0], points[here][1] - points[there][1]);
      if (through >= length[there] || obstacles.some((area) => meets(area, [points[here], points[there]]))) continue;
      length[there] = through;
      before[there] = here;
    }
  }
  const way = [to];
  for (let at = 1; at !== 0; ) way.unshift(points[(at = before[at])]);
  return way;
}

function around(boxes, from, to, corner) {
  const known = new Set();
  while (known.size <= MOST) {
    const way = shortest([...known], from, to, corner);
    const met = way && boxes.filter((box) => !known.has(box) && meets(box, way));
    if (!met || met.length === 0) return way;
    for (const box of met) known.add(box);
  }
  return null;
}

const cubic = ([a, b, c, d]) => Array.from({ length: PIECES + 1 }, (_, n) => {
  const t = n / PIECES, u = 1 - t;
  return [0, 1].map((k) => u ** 3 * a[k] + 3 * u * u * t * b[k] + 3 * u * t * t * c[k] + t ** 3 * d[k]);
});

/** From a sender's port downwards to a receiver's, around boxes that are not its own: `{ d, points }`. */
export function way(start, end, boxes, own, number) {
  const pull = Math.max(STUB, Math.min(120, Math.hypot(end[0] - start[0], end[1] - start[1]) / 2.5));
  const curve = [start, [start[0], start[1] + pull], [end[0], end[1] - pull], end];
  const points = cubic(curve);
  const isFree = end[1] > start[1] + STUB && !boxes.some((box) => !own.includes(box) && meets(box, points));
  const corners = isFree ? null : around(boxes, [start[0], start[1] + STUB], [end[0], end[1] - STUB], CORNER + MORE * (number % OTHERS));
  if (!corners) return { d: `M${curve[0]}C${curve[1]} ${curve[2]} ${curve[3]}`, points };
  const all = [start, ...corners, end];
  const toward = (corner, other) => {
    const part = Math.min(0.5, ROUND / Math.max(0.001, Math.hypot(other[0] - corner[0], other[1] - corner[1])));
    return [0, 1].map((k) => corner[k] + (other[k] - corner[k]) * part);
  };
  const bends = all.slice(1, -1).map((corner, n) => `L${toward(corner, all[n])}Q${corner} ${toward(corner, all[n + 2])}`);
  return { d: `M${start}${bends.join("")}L${end}`, points: all };
}

/** The point at a share of a way. */
export function pointAt(points, share) {
  const lengths = points.slice(1).map(([x, y], n) => Math.hypot(x - points[n][0], y - points[n][1]));
  let rest = lengths.reduce((sum, one) => sum + one, 0) * share;
  for (let n = 0; n < lengths.length; n++) {
    if (rest <= lengths[n]) return [0, 1].map((k) => points[n][k] + ((points[n + 1][k] - points[n][k]) * rest) / Math.max(0.001, lengths[n]));
    rest -= lengths[n];
  }
  return points.at(-1);
}

/** Where a label stands on its way, apart from what is taken: `{ share, by }`; its place is taken then. */
export function placeLabel(text, points, taken) {
  const width = text.length * LETTER + 6;
  const area = ({ share, by }) => {
    const [x, y] = pointAt(points, share);
    return { x: x + by - width / 2, y: y - ABOVE, width, height: HIGH };
  };
  const common = (a, b) => Math.max(0, Math.min(a.x + a.width, b.x + b.width) - Math.max(a.x, b.x)) * Math.max(0, Math.min(a.y + a.height, b.y + b.height) - Math.max(a.y, b.y));
  let best = null, least = Infinity;
  for (const by of [0, width / 2 + 5, -width / 2 - 5]) {
    for (const share of SHARES) {
      const covered = taken.reduce((sum, one) => sum + common(one, area({ share, by })), 0);
      if (covered < least) [best, least] = [{ share, by }, covered];
      if (covered === 0) break;
    }
    if (least === 0) break;
  }
  taken.push(area(best));
  return best;
}

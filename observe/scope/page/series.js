// The last samples of a signal, in bounded memory, an overview of all, and their reduction to columns of pixels.

const FIRST = 1 << 12, MOST = 1 << 17;
const BLOCK = 64; // samples that are summed up by their least and greatest

const SPANS = 512, FIRST_SPAN = 0.01; // as in the scope's store

// The least and greatest value of each element in each span since the recording began. Spans double when there are more than fit.
export class Overview {
  constructor(elements) {
    this.span = FIRST_SPAN;
    this.isWhole = false; // it has what is still to come, of a file
    this.least = Array.from({ length: elements }, () => new Float32Array(SPANS).fill(NaN));
    this.most = this.least.map((least) => least.slice());
  }

  push(time, values) {
    if (time < 0) time = 0;
    while (time >= SPANS * this.span) this.double();
    const at = Math.floor(time / this.span);
    for (let n = 0; n < this.least.length; n++) this.extend(n, at, values[n], values[n]);
  }

  extend(element, at, low, high) {
    const least = this.least[element], most = this.most[element];
    if (low < least[at] || least[at] !== least[at]) least[at] = low;
    if (high > most[at] || most[at] !== most[at]) most[at] = high;
  }

  double() {
    this.span *= 2;
    for (let element = 0; element < this.least.length; element++) {
      const least = this.least[element].slice(), most = this.most[element].slice();
      this.least[element].fill(NaN);
      this.most[element].fill(NaN);
      for (let at = 0; at < SPANS; at++) this.extend(element, at >> 1, least[at], most[at]);
    }
  }

  // Takes what the scope has.
  merge({ span, elements }) {
    const seconds = span / 1e9;
    while (this.span < seconds * 0.99) this.double();
    elements.forEach((spans, element) => spans.forEach(([low, high], at) => {
      if (low !== null) this.extend(element, Math.floor(((at + 0.5) * seconds) / this.span), low, high);
    }));
  }

  // Widens columns of pixels, which begin at `from`, by what is known of two instants and between them; as `Series.columns`.
  columns(element, from, since, to, perSecond, least, most, width) {
    for (let at = Math.max(0, Math.floor(since / this.span)); at < SPANS && at * this.span < to; at++) {
      const low = this.least[element][at], high = this.most[element][at];
      if (low !== low) continue;
      const begin = Math.max(0, Math.floor((Math.max(since, at * this.span) - from) * perSecond));
      const end = Math.min(width - 1, Math.floor((Math.min(to, (at + 1) * this.span) - from) * perSecond));
      for (let c = begin; c <= end; c++) {
        if (low < least[c]) least[c] = low;
        if (high > most[c]) most[c] = high;
      }
    }
  }
}

export class Series {
  constructor(elements) {
    this.elements = elements;
    this.overview = new Overview(elements);
    this.begin = 0; // number of the oldest sample, since the first
    this.end = 0;
    this.allocate(FIRST);
  }

  allocate(room) {
    const old = this.times && { times: this.times, values: this.values, mask: this.mask };
    this.mask = room - 1;
    this.times = new Float64Array(room);
    this.values = Array.from({ length: this.elements }, () => new Float64Array(room));
    this.least = Array.from({ length: this.elements }, () => new Float64Array(room / BLOCK));
    this.most = Array.from({ length: this.elements }, () => new Float64Array(room / BLOCK));
    // Of the values of a block that are numbers: how many, their sum, and the sum of their squares.
    this.numbers = Array.from({ length: this.elements }, () => new Uint8Array(room / BLOCK));
    this.sums = Array.from({ length: this.elements }, () => new Float64Array(room / BLOCK));
    this.squares = Array.from({ length: this.elements }, () => new Float64Array(room / BLOCK));
    if (!old) return;
    const end = this.end;
    for (this.end = this.begin; this.end < end; ) {
      const from = this.end & old.mask;
      this.put(old.times[from], old.values.map((values) => values[from]));
    }
  }

  push(time, values) {
    this.overview.push(time, values);
    this.put(time, values);
  }

  put(time, values) {
    const room = this.mask + 1;
    if (this.end - this.begin === room) {
      if (room < MOST) this.allocate(room * 2);
      else this.begin += BLOCK; // whole blocks, so that their sums stay right
    }
    const at = this.end & this.mask, block = at >> 6, isFirst = this.end % BLOCK === 0 || this.end === this.begin;
    this.times[at] = time;
    for (let n = 0; n < this.elements; n++) {
      const value = values[n];
      this.values[n][at] = value;
      if (isFirst) {
        this.least[n][block] = this.most[n][block] = NaN;
        this.numbers[n][block] = this.sums[n][block] = this.squares[n][block] = 0;
      }
      if (value !== value) continue;
      if (!(value >= this.least[n][block])) this.least[n][block] = value;
      if (!(value <= this.most[n][block])) this.most[n][block] = value;
      this.numbers[n][block]++;
      this.sums[n][block] += value;
      this.squares[n][block] += value * value;
    }
    this.end++;
  }

  time(index) { return this.times[index & this.mask]; }
  value(index, element = 0) { return this.values[element][index & this.mask]; }
  // From when on the samples are in memory: from the start, if none was dropped.
  get keptFrom() { return this.begin > 0 ? this.time(this.begin) : 0; }
  get lastTime() { return this.end > this.begin ? this.time(this.end - 1) : null; }

  // The first sample that is not before `time`.
  find(time) {
    let low = this.begin, high = this.end;
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (this.times[middle & this.mask] < time) low = middle + 1; else high = middle;
    }
    return low;
  }

  // The last sample that is not after `time`; -1 if there is none in memory.
  before(time) {
    let index = this.find(time);
    if (index === this.end || this.time(index) > time) index--;
    return index < this.begin ? -1 : index;
  }

  // The value that held at an instant; NaN before the first.
  at(time, element = 0) {
    const index = this.before(time);
    return index < 0 ? NaN : this.value(index, element);
  }

  // Of the samples between two instants that are in memory and numbers: { number, mean, rms, least, most }. All but the number are NaN without any.
  statistics(element, from, to) {
    const values = this.values[element], { mask } = this, stop = this.find(to);
    let number = 0, sum = 0, squares = 0, least = NaN, most = NaN;
    const extend = (low, high) => {
      if (!(low >= least)) least = low;
      if (!(high <= most)) most = high;
    };
    for (let index = Math.max(this.begin, this.find(from)); index < stop; ) {
      const block = (index & mask) >> 6;
      if (index % BLOCK === 0 && index + BLOCK <= stop && this.numbers[element][block] === BLOCK) {
        number += BLOCK;
        sum += this.sums[element][block];
        squares += this.squares[element][block];
        extend(this.least[element][block], this.most[element][block]);
        index += BLOCK;
        continue;
      }
      const value = values[index++ & mask];
      if (value !== value) continue;
      number++;
      sum += value;
      squares += value * value;
      extend(value, value);
    }
    return { number, mean: sum / number, rms: Math.sqrt(squares / number), least, most };
  }

  // Fills the least and greatest value of each column of pixels between two instants, including the line between samples, so that columns join. Returns [least, greatest] of all.
  columns(element, from, to, width, least, most) {
    least.fill(Infinity, 0, width);
    most.fill(-Infinity, 0, width);
    const perSecond = width / (to - from), values = this.values[element], { times, mask } = this;
    const kept = this.end > this.begin ? this.time(this.begin) : Infinity;
    if (from < kept) this.overview.columns(element, from, from, Math.min(to, kept), perSecond, least, most, width);
    if (this.overview.isWhole && this.lastTime < to) this.overview.columns(element, from, Math.max(from, this.lastTime), to, perSecond, least, most, width);
    let lowest = Infinity, highest = -Infinity;
    let index = Math.max(this.begin, this.find(from) - 1);
    const stop = Math.min(this.end, this.find(to) + 1);
    let lastX = NaN, lastY = NaN, lastColumn = -1;
    while (index < stop) {
      const y = values[index & mask], x = (times[index & mask] - from) * perSecond, column = Math.floor(x);
      index++;
      if (y !== y) { lastY = NaN; continue; }
      if (lastY === lastY && column !== lastColumn) {
        const slope = (y - lastY) / (x - lastX);
        const begin = Math.max(0, lastColumn), end = Math.min(width - 1, column);
        for (let c = begin; c <= end; c++) {
          const left = lastY + (Math.max(c, lastX) - lastX) * slope, right = lastY + (Math.min(c + 1, x) - lastX) * slope;
          const low = left < right ? left : right, high = left < right ? right : left;
          if (low < least[c]) least[c] = low;
          if (high > most[c]) most[c] = high;
        }
      }
      // All others of this column.
      const boundary = from + (column + 1) / perSecond;
      let low = y, high = y, last = y;
      while (index < stop && last === last) {
        const at = index & mask;
        if ((index & (BLOCK - 1)) === 0 && index + BLOCK <= stop && times[(index + BLOCK - 1) & mask] < boundary) {
          if (this.least[element][at >> 6] < low) low = this.least[element][at >> 6];
          if (this.most[element][at >> 6] > high) high = this.most[element][at >> 6];
          index += BLOCK;
          last = values[(index - 1) & mask];
          continue;
        }
        if (!(times[at] < boundary)) break;
        last = values[at];
        if (last < low) low = last;
        else if (last > high) high = last;
        index++;
      }
      if (column >= 0 && column < width) {
        if (low < least[column]) least[column] = low;
        if (high > most[column]) most[column] = high;
      }
      lastX = (times[(index - 1) & mask] - from) * perSecond;
      lastY = last;
      lastColumn = column;
    }
    for (let c = 0; c < width; c++) {
      if (least[c] < lowest) lowest = least[c];
      if (most[c] > highest) highest = most[c];
    }
    return [lowest, highest];
  }

  // The first crossing of a level after `after`, in a direction; null if there is none yet.
  crossing(element, level, edge, after) {
    const values = this.values[element];
    for (let index = Math.max(this.begin + 1, this.find(after)); index < this.end; index++) {
      const before = values[(index - 1) & this.mask], value = values[index & this.mask];
      const crosses = edge > 0 ? before < level && value >= level : before > level && value <= level;
      if (!crosses) continue;
      const from = this.time(index - 1), time = this.time(index);
      const instant = from + ((level - before) / (value - before)) * (time - from);
      if (instant > after) return instant;
    }
    return null;
  }
}

// The columns of a curve from one frame to the next: known columns are moved, and only new ones are computed.
export class Columns {
  constructor() { this.least = this.most = null; }

  // From column number `start` on, counted from time 0. Returns [least, greatest] of all.
  update(series, element, start, perSecond, width) {
    const isSame = this.series === series && this.perSecond === perSecond && this.least?.length === width;
    const by = start - this.start;
    let first = 0;
    if (isSame && by >= 0 && by < width) {
      if (by > 0) { this.least.copyWithin(0, by); this.most.copyWithin(0, by); }
      // The last one that had samples may have got more, and a line to it.
      const stale = Math.floor(this.until * perSecond) - start - 1;
      first = Math.max(0, Math.min(width - by, stale));
    } else if (this.least?.length !== width) {
      this.least = new Float64Array(width);
      this.most = new Float64Array(width);
    }
    Object.assign(this, { series, perSecond, start, until: series.lastTime ?? -Infinity });
    if (first < width) series.columns(element, (start + first) / perSecond, (start + width) / perSecond, width - first, this.least.subarray(first), this.most.subarray(first));
    let low = Infinity, high = -Infinity;
    for (let c = 0; c < width; c++) {
      if (this.least[c] < low) low = this.least[c];
      if (this.most[c] > high) high = this.most[c];
    }
    return [low, high];
  }
}

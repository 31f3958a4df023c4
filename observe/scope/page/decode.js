// Decodes blocks of a recording (docs/recording-format.md) into records. Times become seconds since the recording's first one.

const HEAD = 16;
const text = new TextDecoder();

// By type: bytes of an element, and how it is read.
const TYPES = [
  null,
  [1, (view, at) => view.getUint8(at)],
  [1, (view, at) => view.getInt8(at)],
  [2, (view, at) => view.getInt16(at, true)],
  [4, (view, at) => view.getInt32(at, true)],
  [8, (view, at) => Number(view.getBigInt64(at, true))],
  [1, (view, at) => view.getUint8(at)],
  [2, (view, at) => view.getUint16(at, true)],
  [4, (view, at) => view.getUint32(at, true)],
  [8, (view, at) => Number(view.getBigUint64(at, true))],
  [4, (view, at) => view.getFloat32(at, true)],
  [8, (view, at) => view.getFloat64(at, true)],
];

export class Decoder {
  // `start`: the recording's first time in nanoseconds, null if it has none yet.
  constructor(to, start) {
    this.to = to;
    this.types = new Map(); // number of a signal: [type, elements]
    this.base = start;
    if (start !== null) to.begins(start);
    this.at = 0;
    this.last = 0;
    this.values = new Float64Array(16);
  }

  // Takes one block. `declares`: it repeats the declarations, with the last state of each process.
  block(buffer, declares) {
    this.bytes = new Uint8Array(buffer);
    this.view = new DataView(buffer);
    if (this.bytes.length < HEAD || this.view.getUint32(0, true) !== 0x4b4c424c) throw new Error("not a block");
    this.last = 0;
    this.at = HEAD;
    while (this.at < this.bytes.length) {
      const kind = this.bytes[this.at++];
      const end = this.number() + this.at;
      this.record(kind, end, declares);
      this.at = end;
    }
  }

  record(kind, end, declares) {
    const { to, bytes, view } = this;
    switch (kind) {
      case 1: { const clock = bytes[this.at++]; to.session(clock, this.text(), this.text()); break; }
      case 2: to.thread(this.number(), this.text()); break;
      case 3: {
        const number = this.number();
        const type = TYPES[bytes[this.at++]];
        const elements = bytes[this.at++];
        if (!type) { this.types.delete(number); break; }
        this.types.set(number, [type[0], type[1], elements]);
        to.signal(number, elements, this.text(), this.text(), this.text());
        break;
      }
      case 4: {
        const number = this.number();
        const type = this.types.get(number);
        if (!type) break;
        const time = this.time();
        const [size, read, elements] = type;
        for (let n = 0; n < elements; n++) this.values[n] = read(view, this.at + n * size);
        to.sample(number, time, this.values);
        break;
      }
      case 5: {
        const thread = this.number(), time = this.time(), level = bytes[this.at++], flags = bytes[this.at++], process = this.number();
        to.message({ thread, time, level, cut: (flags & 1) !== 0, process, target: this.text(), text: this.text() });
        break;
      }
      case 6: {
        const thread = this.number(), time = this.time(), code = this.number(), subject = this.number(), a = this.number(), b = this.number();
        if (declares) to.lastEvent(time, code, subject, a, b, thread);
        else to.event(time, code, subject, a, b, thread);
        break;
      }
      case 7: {
        const subject = bytes[this.at++], number = this.number(), parent = this.number(), name = this.text();
        const executor = this.at < end ? this.number() : 0;
        const level = this.at < end ? this.number() : null;
        to.name(subject, number, parent, name, executor, level);
        break;
      }
      case 8: to.losses(bytes[this.at++], this.number(), this.number()); break;
      case 9: to.epoch(this.time(), Number(view.getBigInt64(this.at, true)) / 1e9); break;
      case 10: to.end(this.time()); break;
      default: // of a later version
    }
  }

  // LEB128, exact to 53 bits.
  number() {
    const bytes = this.bytes;
    let byte = bytes[this.at++];
    if (byte < 0x80) return byte;
    let value = byte & 0x7f, factor = 128;
    do {
      byte = bytes[this.at++];
      value += (byte & 0x7f) * factor;
      factor *= 128;
    } while (byte >= 0x80);
    return value;
  }

  time() {
    const number = this.number();
    this.last += number % 2 === 0 ? number / 2 : -(number + 1) / 2;
    if (this.base === null) { this.base = this.last; this.to.begins(this.base); }
    return (this.last - this.base) / 1e9;
  }

  text() {
    const length = this.number();
    this.at += length;
    return text.decode(this.bytes.subarray(this.at - length, this.at));
  }
}

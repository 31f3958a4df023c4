// The WebSocket to the scope. It is closed while the page is hidden, and opened again later; the scope then sends what was missed.

import { Decoder } from "./decode.js";

const HIDDEN = 20_000; // so long the page may be hidden before it hangs up
const MOST_KEPT = 64 << 20; // bytes that wait while the page is paused
const COUNTS = ["loops", "status"];
const ORDERED = ["begin", "missed", "overview", ...COUNTS]; // words that belong between the blocks

// The token, which is taken out of the address: an address that is passed on has the layout alone.
function token() {
  const address = new URLSearchParams(location.hash.slice(1));
  const given = address.get("token");
  try {
    if (given === null) return sessionStorage.getItem("token");
    sessionStorage.setItem("token", given);
  } catch { return given; } // private: it stays in the address
  address.delete("token");
  const rest = address.toString();
  history.replaceState(null, "", `${location.pathname}${rest && `#${rest}`}`);
  return given;
}

export class Connection {
  constructor(model, clock, handlers) {
    Object.assign(this, { model, clock, handlers });
    this.state = "connecting";
    this.bytes = 0;
    this.kept = [];
    this.keptBytes = 0;
    this.sets = new Map();
    this.nextSet = 1;
    this.token = token();
    document.addEventListener("visibilitychange", () => this.visibility());
    clock.listeners.add(() => clock.live && this.release());
    this.open();
  }

  open() {
    clearTimeout(this.retry);
    this.socket = new WebSocket(`ws://${location.host}/live`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.become("open");
      if (this.token) this.say({ type: "token", token: this.token });
    };
    this.socket.onmessage = ({ data }) => this.take(data);
    this.socket.onclose = ({ wasClean }) => {
      // The scope says that it is closed; a connection that breaks says nothing.
      if (this.state === "open") this.wasClosed = wasClean;
      this.become(this.asleep ? "asleep" : "away");
      for (const settle of this.sets.values()) settle("the scope is gone");
      this.sets.clear();
      if (!this.asleep) this.retry = setTimeout(() => this.open(), 1000);
    };
  }

  become(state) {
    this.state = state;
    this.handlers.state?.(state);
  }

  visibility() {
    clearTimeout(this.hiding);
    if (document.hidden) {
      this.hiding = setTimeout(() => {
        if (!this.clock.live) return; // what is looked at stays
        this.asleep = true;
        clearTimeout(this.retry);
        this.socket.close();
      }, HIDDEN);
    } else if (this.asleep) {
      this.asleep = false;
      this.open();
    }
  }

  say(word) { if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(word)); }

  // Asks for a span of the file that is played.
  seek(from, until) {
    this.clock.follow();
    this.say({ type: "seek", from: Math.max(0, from), until: Math.max(0, until) });
  }

  // Sets a parameter; gives why it was not set, or null.
  set(name, value) {
    return new Promise((settle) => {
      const id = this.nextSet++;
      if (this.socket.readyState !== WebSocket.OPEN) return settle("the scope is gone");
      this.sets.set(id, settle);
      this.say({ type: "set", id, name, value });
    });
  }

  take(data) {
    if (typeof data !== "string") this.bytes += data.byteLength;
    const word = typeof data === "string" ? JSON.parse(data) : null;
    if (word && !ORDERED.includes(word.type)) return this.hear(word);
    // While the page is paused, memory is kept: otherwise what is shown would be overwritten.
    if (!this.clock.live) return this.keep(word ?? data);
    this.apply(word ?? data);
    if (!word) this.clock.settle(performance.now());
  }

  keep(piece) {
    if (piece.type === "begin") [this.kept, this.keptBytes] = [[], 0]; // which forgets all before
    if (COUNTS.includes(piece.type)) {
      // An emergency is shown at once. It is heard again in its order, after a `begin`; the last word has all of those before.
      this.hear(piece);
      this.kept = this.kept.filter(({ type }) => type !== piece.type);
    }
    this.kept.push(piece);
    this.keptBytes += piece.byteLength ?? 0;
    let dropped = 0;
    while (this.keptBytes > MOST_KEPT) {
      // Declarations stay: without them what follows means nothing.
      const at = this.kept.findIndex((one, n) => one.byteLength && !this.isDeclaration(n));
      if (at < 0) break;
      this.keptBytes -= this.kept[at].byteLength;
      this.kept.splice(at, 1);
      dropped++;
    }
    this.model.missed += dropped;
  }

  isDeclaration(n) {
    for (let back = 1; back <= n && back < 64; back++) {
      const before = this.kept[n - back];
      if (!before.byteLength) return before.declarations >= back;
    }
    return false;
  }

  release() {
    const kept = this.kept;
    this.kept = [];
    this.keptBytes = 0;
    for (const piece of kept) this.apply(piece);
    if (kept.length) this.clock.settle(performance.now());
  }

  apply(piece) {
    if (piece.byteLength !== undefined) {
      try {
        this.decoder?.block(piece, this.declarations > 0);
      } catch (error) {
        this.handlers.problem?.(`A block could not be read: ${error.message}`);
      }
      this.declarations--;
    } else if (piece.type === "overview") {
      this.model.overview(piece);
    } else if (COUNTS.includes(piece.type)) {
      this.hear(piece);
    } else {
      if (piece.type === "begin") {
        this.model.reset();
        this.clock.reset();
        const start = piece.start === null ? null : Number(piece.start);
        this.decoder = new Decoder(this.model, start);
        const after = (time) => (time === null ? 0 : (Number(time) - start) / 1e9);
        [this.model.samplesFrom, this.model.eventsFrom] = piece.kept_from.map(after);
        [this.model.until, this.model.known] = [piece.until, piece.last].map(after);
        this.handlers.begin?.();
      } else this.model.missed += piece.blocks;
      this.declarations = piece.declarations;
    }
  }

  hear(word) {
    switch (word.type) {
      case "hello": this.hello = word; this.handlers.hello?.(word); break;
      case "loops": this.model.count(word); break;
      case "status": this.model.know(word.status); break;
      case "parameters": this.handlers.parameters?.(word.list); break;
      case "authorized": this.handlers.authorized?.(word.ok); break;
      case "set": this.sets.get(word.id)?.(word.error); this.sets.delete(word.id); break;
    }
  }
}

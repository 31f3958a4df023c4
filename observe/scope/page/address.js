// The layout in the page's address: the view, the signals, their scales, the axes, and the span of time.

const LAYOUTS = ["stack", "overlay", "xy"];

export class Address {
  // `seen`: gives the view that is shown; `show`: shows one.
  constructor(signals, connection, seen, show) {
    Object.assign(this, { signals, connection, seen, show });
    this.until = null; // where the plot is to stand, as soon as that instant is known
    this.read();
    addEventListener("hashchange", () => this.read());
  }

  // Only what differs from the page as it is at first.
  write() {
    const { signals } = this, { list, clock } = signals;
    if (location.hash !== this.hash) this.read(); // entered in this frame; its event is yet to come
    if (this.until !== null) return; // not restored yet
    const now = new URLSearchParams();
    if (this.seen() !== "signals") now.set("view", this.seen());
    if (signals.layout !== "stack") now.set("layout", signals.layout);
    if (signals.chosenSpan !== null) now.set("span", Number(signals.chosenSpan.toPrecision(6)));
    if (!clock.live && signals.end !== null) now.set("until", signals.end.toFixed(6));
    if (signals.readings.statistics) now.set("statistics", "");
    if (list.chosenByHand) for (const key of list.chosen.size > 0 ? list.chosen : [""]) now.append("signal", key);
    for (const { key, gain, offset } of list.rows.values()) if (gain !== 1 || offset !== 0) now.append("adjust", `${key} × ${gain} + ${offset}`);
    if (signals.layout === "xy") signals.xy.keys.forEach((key, n) => key !== null && now.set("xy"[n], key));
    for (const [key, { low, high }] of signals.held) now.append("axis", `${key} from ${low} to ${high}`);
    const text = now.toString().replaceAll("%2F", "/").replaceAll("%5B", "[").replaceAll("%5D", "]").replaceAll("%2C", ",").replace(/=(?=&|$)/g, "");
    if (text === this.text) return;
    this.text = text;
    history.replaceState(null, "", `${location.pathname}${text && `#${text}`}`);
    this.hash = location.hash; // escaped as the browser does it
  }

  read() {
    const { signals } = this, { list } = signals;
    const text = location.hash.slice(1), then = new URLSearchParams(text);
    this.hash = location.hash;
    if (text === this.text) return;
    this.text = text;
    const layout = then.get("layout"), span = Number(then.get("span")), until = Number(then.get("until"));
    if (span > 0 && isFinite(span)) signals.spread(span);
    if (then.has("signal")) {
      list.chosenByHand = true;
      list.chosen.clear();
      for (const key of then.getAll("signal")) if (key !== "") list.chosen.add(key);
      list.paint();
    }
    for (const one of then.getAll("adjust")) {
      const found = /^(.*) × (\S+) \+ (\S+)$/.exec(one);
      if (!found) continue;
      const [, key, ...numbers] = found;
      list.adjusted.set(key, numbers.map(Number));
      list.rows.get(key)?.adjust(...numbers.map(Number));
    }
    for (const one of then.getAll("axis")) {
      const [, key, low, high] = /^(.*) from (\S+) to (\S+)$/.exec(one) ?? [];
      signals.hold(key, Number(low), Number(high));
    }
    ["x", "y"].forEach((name, n) => { signals.xy.keys[n] = then.get(name) ?? signals.xy.keys[n]; });
    if (LAYOUTS.includes(layout)) signals.lay(layout);
    if (then.has("statistics")) signals.readings.toggle(true);
    if (then.has("until") && isFinite(until)) this.until = until;
    if (then.has("view")) this.show(then.get("view"));
  }

  // Stands where it stood, as soon as the data until there has come. A run that has not come so far yet is followed.
  frame() {
    const { signals, until } = this, { model, clock } = signals;
    if (until === null || clock.latest === 0) return;
    const isKnown = until <= Math.max(model.last, model.known) + 1e-6;
    if (!clock.live || !isKnown) { this.until = null; return; } // or one was quicker
    if (clock.latest >= until - 1e-6) {
      this.until = null;
      clock.pause(Math.max(0, Math.min(until, clock.latest)));
      signals.end = until;
    } else if (until > model.known && !this.sought) {
      this.sought = true;
      this.connection.seek(until - signals.span, until);
    }
  }
}

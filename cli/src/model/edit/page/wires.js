// What is connected with what.

/** The channel or port of a text such as `left[(i + 1) % 5]`. */
export const base = (text) => text.split("[")[0].trim();

/** The element of an array that a text such as `blocks[3]` names; null if it is computed, or none. */
const elementOf = (text) => /\[\s*(\d+)\s*\]$/.exec(text)?.[1] ?? null;

/** Whether two ends can be those of one channel of an array. */
export const canMeet = (from, to) => from.element === null || to.element === null || from.element === to.element;

export const get = (pairs, key) => pairs.find(([name]) => name === key)?.[1];

/** A scope's channels with their ends: boxes' names and ports. */
export function connected(scope, processes) {
  const wires = new Map(scope.channels.map((channel) => [channel.name, { channel, name: channel.name, send: [], receive: [] }]));
  const sides = new Map(processes.map((process) => [process.name, new Map(process.ports)]));
  for (const [name, side] of scope.ports) {
    // Within, the port is the other end.
    const wire = { channel: null, name, send: [], receive: [] };
    wire[side === "send" ? "receive" : "send"].push({ box: `port ${name}`, port: name, element: null });
    wires.set(name, wire);
  }
  for (const part of scope.parts) {
    for (const [port, text] of part.bind) {
      const side = sides.get(part.process)?.get(port);
      const wire = wires.get(base(text));
      if (side && wire) wire[side].push({ box: `part ${part.name}`, port, element: elementOf(text) });
    }
  }
  return [...wires.values()];
}

/** The channels that no port is bound to after some were unbound. */
export function unused(scope, processes, without) {
  const used = new Set();
  for (const part of scope.parts) {
    for (const [port, text] of part.bind) if (!without(part.name, port)) used.add(base(text));
  }
  const before = new Set(scope.parts.flatMap((part) => part.bind.map(([, text]) => base(text))));
  return scope.channels.map((one) => one.name).filter((name) => before.has(name) && !used.has(name));
}

/** The edits that connect two ports, or why they cannot be: `{edits}` or `{error}`. */
export function connect(scope, a, b) {
  if (a.box === b.box && a.port === b.port) return { edits: [] };
  const terminal = [a, b].find((end) => end.box.startsWith("port "));
  const thing = (kind, name) => ({ kind, within: scope.within, name });
  const part = (end) => scope.parts.find((one) => `part ${one.name}` === end.box);
  const bind = (end, value) => ({ do: "set", thing: thing("part", part(end).name), key: `bind.${end.port}`, value });
  const bound = (end) => get(part(end).bind, end.port);
  const tidy = (changed) => unused(scope, [], (name, port) => changed.some((end) => end.box === `part ${name}` && end.port === port))
    .map((name) => ({ do: "remove", thing: thing("channel", name) }));
  if (terminal) {
    const inner = terminal === a ? b : a;
    if (inner.box.startsWith("port ")) return { error: "two ports of the process cannot be connected: put a part between them" };
    if (inner.side !== terminal.side) return { error: `the port ${terminal.port} has the other direction` };
    return { edits: [...tidy([inner]), bind(inner, terminal.port)] };
  }
  if (a.side === b.side) {
    const to = bound(a) ?? bound(b);
    if (!to) return { error: "both ports have the same direction: one must send, the other receive" };
    const end = bound(a) ? b : a;
    return { edits: [bind(end, to)] };
  }
  const [sender, receiver] = a.side === "send" ? [a, b] : [b, a];
  const known = [bound(sender), bound(receiver)];
  if (known[0] && !known[1]) return { edits: [bind(receiver, known[0])] };
  if (known[1] && !known[0]) return { edits: [bind(sender, known[1])] };
  if (known[0]) {
    if (base(known[0]) === base(known[1])) return { edits: [] };
    const edits = tidy([receiver]).filter((one) => one.thing.name !== base(known[0]));
    return { edits: [...edits, bind(receiver, known[0])] };
  }
  const taken = new Set([...scope.channels.map((one) => one.name), ...scope.ports.map(([name]) => name)]);
  let name = sender.port;
  for (let n = 2; taken.has(name); n++) name = `${sender.port}_${n}`;
  const arrays = [sender, receiver].map((end) => part(end).array);
  const array = arrays[0] ?? arrays[1];
  const keys = array ? [["array", /^\d+$/.test(array) ? Number(array) : array]] : [];
  const text = (of) => (array ? `${name}[${of ? "i" : "0"}]` : name);
  return { name, edits: [{ do: "add", thing: thing("channel", name), keys }, bind(sender, text(arrays[0])), bind(receiver, text(arrays[1]))] };
}

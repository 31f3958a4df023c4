// What a plot shows, as a file.

import { make } from "./text.js";
import { colours } from "./draw.js";

function save(blob, name) {
  const link = make("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const cell = (text) => (/[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

// A row for each instant at which one of the curves has a sample; cells of curves without a sample there are empty.
export function csv(curves, from, to) {
  const names = curves.map(({ name, signal }) => cell(signal.unit ? `${name} (${signal.unit})` : name));
  const lines = [["time (s)", ...names].join(",")];
  const all = curves.map(({ signal: { series }, element }) => ({ series, element, at: series.find(from) }));
  for (;;) {
    let time = Infinity;
    for (const { series, at } of all) if (at < series.end) time = Math.min(time, series.time(at));
    if (time > to) break;
    const cells = all.map((one) => {
      const { series, element, at } = one;
      if (at >= series.end || series.time(at) !== time) return "";
      one.at++;
      return String(series.value(at, element));
    });
    lines.push([time.toFixed(9), ...cells].join(","));
  }
  return lines.join("\r\n") + "\r\n";
}

export function exportCsv(signals) {
  const [from, to] = signals.window();
  save(new Blob([csv(signals.curves, from, to)], { type: "text/csv" }), "scope.csv");
}

export function exportPng(signals) {
  const { width, height } = signals.under;
  const canvas = make("canvas", { width, height });
  const context = canvas.getContext("2d");
  context.fillStyle = colours().surface;
  context.fillRect(0, 0, width, height);
  for (const layer of [signals.under, signals.traces, signals.over]) context.drawImage(layer, 0, 0);
  canvas.toBlob((blob) => save(blob, "scope.png"), "image/png");
}

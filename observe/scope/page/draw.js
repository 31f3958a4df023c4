// Drawing: canvases in device pixels, and a painter that fills columns of an image, which is many times faster than strokes where there are many lines.

import { number } from "./text.js";

const NAMES = ["grid", "line", "text", "muted", "faint", "surface", "accent", "on-accent", "on-alarm", "running", "ready", "waiting", "done", "failed", "arrow"];
let palette = null;

// The page's colours, as its style sheet has them now.
export function colours() {
  const { theme } = document.documentElement.dataset;
  if (palette?.theme !== theme) {
    const style = getComputedStyle(document.documentElement);
    palette = Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    palette.theme = theme;
  }
  return palette;
}

// Colours that can be distinguished with any colour vision; neighbours differ in lightness too.
const LIGHT = ["#2b62d9", "#c25a00", "#00816a", "#a63a94", "#7a6100", "#0b87a8", "#b8322a", "#5f4fc9"];
const DARK = ["#7ba6ff", "#f59a4a", "#3fcfab", "#e58ad6", "#d9be52", "#5cc8e6", "#ff8a7d", "#ada1ff"];
export const isDark = () => document.documentElement.dataset.theme === "dark";
export const colourOf = (n) => (isDark() ? DARK : LIGHT)[n % LIGHT.length];

// Resizes the canvas to its size on the screen. Returns whether it has changed.
export function fit(canvas, width = canvas.clientWidth, height = canvas.clientHeight) {
  const ratio = Math.min(2, window.devicePixelRatio || 1);
  const wide = Math.max(1, Math.round(width * ratio)), high = Math.max(1, Math.round(height * ratio));
  const changed = canvas.width !== wide || canvas.height !== high;
  if (changed) { canvas.width = wide; canvas.height = high; }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, ratio, width, height, changed };
}

// Says on a canvas that what lies between two instants' places is not in memory any more.
export function gone(context, palette, begin, end, [left, top, right, bottom]) {
  begin = Math.max(left, begin);
  end = Math.min(right, end);
  if (end - begin < 1) return;
  context.fillStyle = palette.grid;
  context.fillRect(begin, top, end - begin, bottom - top);
  if (end - begin < 130) return;
  context.fillStyle = palette.muted;
  context.textAlign = "center";
  context.fillText("no longer in memory", (begin + end) / 2, (top + bottom) / 2);
}

// The edges of the plot of signals, in CSS pixels. At the bottom are the marks and the times.
export const AXIS = 62, RIGHT = 14, TOP = 10, BOTTOM = 42;

// A value beside an axis, without needless zeros.
export function label(value) {
  const text = number(value);
  return /e|^[^.]*$/.test(text) ? text : text.replace(/\.?0+$/, "");
}

export class Painter {
  resize(width, height) {
    if (this.width === width && this.height === height) return;
    this.image = new ImageData(width, height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.width = width;
    this.height = height;
  }

  clear() { this.pixels.fill(0); }

  // A colour as the image has it, opaque.
  static colour(text) {
    const number = parseInt(text.slice(1), 16);
    return (((number & 0xff) << 16) | (number & 0xff00) | (number >> 16)) >>> 0;
  }

  // One column of a curve from `top` to `bottom`, of which it covers a share. Its end pixels are as opaque as the part that it covers.
  column(x, top, bottom, colour, ceiling, floor, share = 1) {
    if (top < ceiling) top = ceiling;
    if (bottom > floor) bottom = floor;
    if (bottom <= top) return;
    const { pixels, width } = this;
    const first = Math.floor(top), last = Math.ceil(bottom) - 1;
    if (first === last) return this.dot(first * width + x, colour, (bottom - top) * share);
    this.dot(first * width + x, colour, (first + 1 - top) * share);
    const full = (colour | 0xff000000) >>> 0, end = last * width + x;
    if (share === 1) for (let at = (first + 1) * width + x; at < end; at += width) pixels[at] = full;
    else for (let at = (first + 1) * width + x; at < end; at += width) this.dot(at, colour, share);
    this.dot(last * width + x, colour, (bottom - last) * share);
  }

  dot(at, colour, cover) {
    const strength = Math.round(cover * 255);
    if (strength > this.pixels[at] >>> 24) this.pixels[at] = (colour | (strength << 24)) >>> 0;
  }

  // A curve: its least and greatest value in each column. Steep parts are as thick as flat ones, and all of it is as thick at the edges of its lane, which it passes by half a line.
  curve(least, most, width, left, low, high, top, bottom, colour, thick) {
    const scale = (bottom - top) / (high - low), half = thick / 2, beside = Math.min(1, half - 0.5);
    const ceiling = top - half, floor = bottom + half;
    for (let x = 0; x < width; x++) {
      if (most[x] < least[x]) continue;
      const y0 = bottom - (most[x] - low) * scale, y1 = bottom - (least[x] - low) * scale;
      // A negative scale turns the curve upside down.
      const upper = Math.min(y0, y1) - half, lower = Math.max(y0, y1) + half;
      this.column(left + x, upper, lower, colour, ceiling, floor);
      if (lower - upper < 2 * thick || beside <= 0) continue;
      if (x > 0) this.column(left + x - 1, upper, lower, colour, ceiling, floor, beside);
      if (x < width - 1) this.column(left + x + 1, upper, lower, colour, ceiling, floor, beside);
    }
  }

  show(context) { context.putImageData(this.image, 0, 0); }
}

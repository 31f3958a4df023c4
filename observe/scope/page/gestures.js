// Pan by drag, zoom by wheel and pinch, and the same by keys.

// `on`: pan(pixels), zoom(factor, x, y of a wheel), tap(x, y), hover(x, y) or leave(), grab(x, y) -> an object that is dragged instead, with drag(x, y), key(event) -> handled.
export function gestures(element, on) {
  const pointers = new Map();
  let held = null, moved = 0, distance = 0;
  const place = (event) => {
    const box = element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    const [x, y] = place(event);
    element.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [x, y]);
    moved = 0;
    held = pointers.size === 1 ? on.grab?.(x, y) ?? null : null;
    if (pointers.size === 2) distance = apart();
  });
  const apart = () => {
    const [[x0, y0], [x1, y1]] = pointers.values();
    return Math.max(20, Math.hypot(x1 - x0, y1 - y0));
  };
  element.addEventListener("pointermove", (event) => {
    const [x, y] = place(event);
    const before = pointers.get(event.pointerId);
    if (!before) return on.hover?.(x, y);
    pointers.set(event.pointerId, [x, y]);
    moved += Math.abs(x - before[0]) + Math.abs(y - before[1]);
    if (pointers.size === 2) {
      const now = apart();
      const middle = [...pointers.values()].reduce((sum, [px]) => sum + px / 2, 0);
      on.zoom(distance / now, middle);
      distance = now;
    } else if (held) held.drag(x, y);
    else if (moved > 4) on.pan(x - before[0]);
  });
  const up = (event) => {
    const last = pointers.get(event.pointerId);
    pointers.delete(event.pointerId);
    if (last && event.type === "pointerup" && moved <= 4 && !held) on.tap?.(...last);
    if (pointers.size === 0) held = null;
  };
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("pointerleave", () => on.leave?.());
  element.addEventListener("wheel", (event) => {
    if (on.passes?.(place(event)[0])) return; // for the page to scroll
    if (event.deltaY) {
      event.preventDefault();
      on.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.004), ...place(event));
    } else if (event.deltaX) {
      event.preventDefault();
      on.pan(-event.deltaX);
    }
  }, { passive: false });
  element.addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    const middle = element.clientWidth / 2;
    const keys = {
      ArrowLeft: () => on.pan(element.clientWidth / 10), ArrowRight: () => on.pan(-element.clientWidth / 10),
      "+": () => on.zoom(0.7, middle), "=": () => on.zoom(0.7, middle), "-": () => on.zoom(1 / 0.7, middle), Home: () => on.home?.(),
    };
    const act = keys[event.key];
    if (act) { event.preventDefault(); act(); }
  });
}

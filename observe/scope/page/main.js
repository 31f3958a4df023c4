// The page: the selected view, the header, and the loop over frames.

import { Address } from "./address.js";
import { Clock } from "./clock.js";
import { Model } from "./model.js";
import { Connection } from "./connection.js";
import { Ending } from "./ending.js";
import { stopText } from "./marks.js";
import { Signals } from "./signals.js";
import { Picture } from "./picture.js";
import { Loops } from "./loops.js";
import { Composition } from "./composition.js";
import { Timeline } from "./timeline.js";
import { Messages } from "./messages.js";
import { Parameters } from "./parameters.js";
import { $, make, put, count, instant } from "./text.js";

const DEGREES = ["normal", "Warning", "Safe state", "Emergency"];

const clock = new Clock();
const model = new Model(clock);
let problem = null;
const connection = new Connection(model, clock, {
  begin: () => { problem = null; showState(); },
  state: () => showState(),
  hello: (hello) => {
    $("#tab-parameters").hidden = !hello.parameters;
    $("#tab-picture").hidden = !views.picture.load(hello.picture);
    parameters.send();
  },
  parameters: (list) => parameters.list(list),
  authorized: (ok) => parameters.authorized(ok),
  problem: (text) => { problem = text; },
});
const timeline = new Timeline(model, clock);
const parameters = new Parameters(connection);
const views = {
  signals: new Signals(model, clock),
  picture: new Picture(model, clock),
  loops: new Loops(model, clock, (late) => { show("timeline"); timeline.show(late.seconds, late.lateness / 1e9, late.loop); }),
  composition: new Composition(model, clock),
  timeline,
  messages: new Messages(model),
  parameters: { frame() {} },
};
views.signals.marks.show = (mark) => {
  if (mark.kind === "late") { show("timeline"); timeline.show(mark.time, mark.lateness, mark.loop); }
  else show(mark.text === undefined ? "timeline" : mark.kind === "parameter" ? "parameters" : "messages");
  if (mark.kind === "emergency" || mark.degree === 1) timeline.show(mark.time, 0.005);
};
const ending = new Ending(model, connection);
views.signals.whole.seek = (from, until) => connection.seek(from, until);
const tabs = [...document.querySelectorAll("[role=tab]")];
let seen = "signals";

function show(name) {
  seen = Object.hasOwn(views, name) ? name : "signals";
  for (const tab of tabs) {
    const isSeen = tab.id === `tab-${seen}`;
    tab.setAttribute("aria-selected", isSeen);
    tab.tabIndex = isSeen ? 0 : -1;
    $(`#${tab.getAttribute("aria-controls")}`).hidden = !isSeen;
  }
}

for (const tab of tabs) tab.onclick = () => show(tab.getAttribute("aria-controls"));
$("#tabs").onkeydown = (event) => {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!step) return;
  const shown = tabs.filter((tab) => !tab.hidden);
  const next = shown[(shown.findIndex((tab) => tab.id === `tab-${seen}`) + step + shown.length) % shown.length];
  next.click();
  next.focus();
};

// Light or dark: as the system has it, unless chosen.
const dark = matchMedia("(prefers-color-scheme: dark)");
const chosen = () => { try { return localStorage.getItem("theme"); } catch { return null; } };
const theme = () => { document.documentElement.dataset.theme = chosen() ?? (dark.matches ? "dark" : "light"); views.signals.list.paint(); };
dark.addEventListener("change", theme);
$("#theme").onclick = () => {
  try { localStorage.setItem("theme", document.documentElement.dataset.theme === "dark" ? "light" : "dark"); } catch { /* private */ }
  theme();
};

$("#pause").onclick = () => (clock.live ? clock.pause() : clock.follow());
$("#speed").onchange = (event) => {
  clock.speed = Number(event.target.value);
  // From the beginning of what is seen, if its end is reached.
  if (clock.speed > 0 && clock.now >= clock.latest - 1e-6) clock.now = Math.max(0, clock.latest - 2);
};
clock.listeners.add(showState);

function showState() {
  const isAway = connection?.state !== "open";
  const is = !clock.live ? "paused" : model.ended !== null ? "over" : isAway ? "away" : "live";
  const words = { paused: "Paused", away: "No connection", over: "Ended", live: "Live" };
  $("#state").dataset.is = is;
  put($("#state"), words[is]);
  put($("#pause"), clock.live ? "Pause" : "Follow");
  $(".slow").hidden = clock.live;
  if (clock.speed === 0 && $("#speed").value !== "0") $("#speed").value = "0";
}

const CHECKBOX = "input[type=checkbox]", TEXT = `input:not(${CHECKBOX}), textarea`;
document.addEventListener("keydown", (event) => {
  const { target, key } = event;
  if (target.matches(TEXT) || event.altKey || event.ctrlKey || event.metaKey) return;
  if (key === " ") { event.preventDefault(); if (!event.repeat) $("#pause").click(); }
  else if (key === "Enter" && target.matches(CHECKBOX)) { event.preventDefault(); target.click(); }
  else if (!target.matches("select")) views[seen].key?.(key); // letters choose there
});

// Space on a button or a checkbox pauses, and does not press it as well: Enter does.
document.addEventListener("keyup", (event) => event.key === " " && event.target.matches(`button, ${CHECKBOX}`) && event.preventDefault());

function banner() {
  const { emergency } = model.status;
  const degree = emergency?.degree ?? 0;
  const box = $("#emergency");
  box.hidden = degree === 0;
  if (box.hidden) return;
  const key = JSON.stringify(emergency) + model.version;
  if (box.dataset.key === key) return;
  box.dataset.key = key;
  const stop = stopText(emergency.signal);
  box.dataset.degree = stop ? "stop" : degree;
  const raiser = model.processes.get(emergency.process)?.name;
  const seconds = model.base === undefined ? "" : `since ${instant(model.seconds(emergency.time), 1e-3)}`;
  if (stop) return box.replaceChildren(stop.replace("s", "S"), make("span", { class: "when number" }, seconds.replace("since", "at")));
  box.replaceChildren(`${DEGREES[degree] ?? "Emergency"}${raiser ? `, raised by ${raiser}` : ""}`, make("span", { class: "when number" }, seconds));
}

let updated = 0, frames = 0, bytes = 0, samples = 0;
function foot(now) {
  const elapsed = (now - updated) / 1000;
  if (elapsed < 1) return;
  put($("#frames"), `${Math.round(frames / elapsed)} frames/s`);
  put($("#rate"), `${count(Math.max(0, model.samples - samples) / elapsed)} samples/s · ${((connection.bytes - bytes) / elapsed / 1000).toFixed(0)} kB/s`);
  ({ bytes } = connection);
  ({ samples } = model);
  updated = now;
  frames = 0;
  const { status } = model;
  const losses = [];
  if (model.lostInAll) losses.push(`${count(model.lostInAll)} lost by the recorder`);
  const samplesKept = model.samplesKept(views.signals.shown), { eventsKept } = model;
  if (samplesKept > 0) losses.push(`of signals until ${instant(samplesKept, 0.1)} an overview`);
  if (model.samplesFrom > 0) losses.push(`of messages until ${instant(model.samplesFrom, 0.1)} the last warnings and errors`);
  if (eventsKept > 0) losses.push(`of events until ${instant(eventsKept, 0.1)} nothing is kept`);
  if (model.missed) losses.push(`${count(model.missed)} blocks missed by this page`);
  if (status.left_out_samples || status.left_out_events) losses.push(`${count(status.left_out_samples + status.left_out_events)} too many to show`);
  if (status.left_out_declarations) losses.push("too much is declared to show all of it");
  if (status.problem || problem) losses.push(status.problem ?? problem);
  put($("#losses"), losses.join(" · ") || "nothing lost");
  $("#losses").classList.toggle("bad", model.lostInAll > 0 || model.missed > 0 || Boolean(status.problem ?? problem));
  const late = model.counts.late_in_all;
  $("#late-count").hidden = late === 0;
  put($("#late-count"), count(late));
  const bad = model.messages.reduce((sum, { level }) => sum + (level <= 2), 0);
  $("#message-count").hidden = bad === 0;
  put($("#message-count"), count(bad));
  put($("#system"), model.system);
  $("#system").hidden = model.system === "";
  showState();
  address.write();
}

function frame(now) {
  address.frame();
  clock.advance(now);
  frames++;
  views[seen].frame(now);
  banner();
  ending.frame();
  foot(now);
  const date = model.date && !model.virtual ? new Date((model.date.unix + clock.now - model.date.time) * 1000).toLocaleTimeString() : "";
  put($("#clock"), `${instant(clock.now, 0.1)}${date && ` · ${date}`}`);
  requestAnimationFrame(frame); // which the browser does not call while the page is hidden
}

// The skip link is not a layout.
$(".skip").onclick = (event) => { event.preventDefault(); $("#view").focus(); };

show("signals");
theme();
const address = new Address(views.signals, connection, () => seen, show);
// For tests, and for the browser's console.
window.scope = { model, clock, connection, views, show, address };
showState();
requestAnimationFrame(frame);

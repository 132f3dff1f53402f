// Puts the page together: a live page is fed by a socket, a replay by its recording.

import { Charts } from "cockpit/charts.js";
import { Drive } from "cockpit/drive.js";
import { startKeys } from "cockpit/keys.js";
import { Link } from "cockpit/link.js";
import { Network } from "cockpit/latency_and_disturbances.js";
import { Gauges } from "cockpit/gauges.js";
import { Figures, Frames, Lights } from "cockpit/panels.js";
import { Player } from "cockpit/player.js";
import { readRecording } from "cockpit/recording.js";
import { Rows } from "cockpit/rows.js";
import { Scene } from "cockpit/scene.js";
import { Setup } from "cockpit/setup.js";
import { startTheme } from "cockpit/theme.js";
import { byId, element, inUnit, pressed, setText } from "cockpit/words.js";

const TOAST_MS = 6000;
const READ_S = 0.1; // no one reads figures that change more often
const METRES_FROM_M = 1; // a car that was so far off is told of in metres

// What all parts of the page share.
const app = {
  head: null, signals: {}, lanes: [], lost: [], lane: 0, status: null, player: null,
  heldS: null, isTouched: true, hasMoved: true, drawn: 0, link: null, isDriven: false, isInMetres: false,
  touch() { this.isTouched = this.hasMoved = true; },
  moveOn() { this.hasMoved = true; }, // nothing but the time is another
  wish(wish) { this.link?.wish(wish); },
  get charts() { return charts; },
  get network() { return network; },
  get drive() { return drive; },
  get nowS() { return this.player?.nowS ?? this.heldS ?? Math.max(0, ...this.lanes.map((rows) => rows.endS)); },
  selectLane(lane) {
    if (lane >= this.lanes.length) return;
    this.lane = lane;
    drawStatus();
  },
};
const charts = new Charts(app), scene = new Scene(app), figures = new Figures(app);
const lights = new Lights(app), frames = new Frames(app), network = new Network(app), setup = new Setup(app), drive = new Drive(app), gauges = new Gauges(app);

function take(head) {
  app.head = head;
  useMetres(false);
  app.lane = 0;
  app.heldS = null;
  pressed(byId("hold"), false);
  setText(byId("bus"), head.bus || "starting the programs …");
  byId("bus").title = head.bus;
}

function build() {
  if (!app.head) return;
  for (const part of [charts, figures, gauges, lights, frames]) part.build();
  app.touch();
}

// All lengths of the page have one unit.
function useMetres(isInMetres) {
  const before = app.signals;
  app.isInMetres = isInMetres;
  app.signals = Object.fromEntries(app.head.signals.map((signal) => [signal.name, inUnit(signal, isInMetres)]));
  charts.rescale((name) => app.signals[name].scale / (before[name] ?? app.signals[name]).scale);
}

function chooseUnit(nowS) {
  const isFar = app.lanes.some((rows) => rows.value("peak_m", nowS) >= METRES_FROM_M);
  if (app.isInMetres === (isFar || app.isDriven)) return;
  useMetres(!app.isInMetres);
  for (const part of [charts, figures]) part.build();
}

// A car of ours that is lost is put back, once.
function putBack(lanes) {
  lanes.forEach(({ lost, grip }, lane) => {
    if (lost === Boolean(app.lost[lane])) return;
    app.lost[lane] = lost;
    if (!lost || !app.head.is_own) return;
    if (app.isDriven) drive.lose(grip);
    else toast([`${app.head.lanes[lane].label} has lost the path: it is put back to its start`, grip].filter(Boolean).join("; "));
    app.wish({ do: "process", lane, program: "plant", action: "put_back" });
  });
}

function buildControls() {
  const { head } = app;
  const listens = !head.may_control && element("div", { className: "group" }, element("p", { className: "note" }, "This page only listens: --allow-control lets it send."));
  byId("controls").replaceChildren(...[listens, head.is_own && setup.scenarios(), ...network.build(!head.may_control), setup.recording(), head.is_own && setup.programs()].filter(Boolean));
}

function drawStatus() {
  const { status } = app;
  if (!status) return;
  const failure = status.lanes.map((lane) => lane.failure).find(Boolean);
  setText(byId("connection"), failure || (status.busy && `${status.busy} …`) || "");
  if (!app.lanes.length) return;
  if (!app.player) putBack(status.lanes);
  lights.draw(status.lanes.map((lane) => lane.lights));
  frames.draw(status.lanes[app.lane]?.frames);
  setup.draw(status);
}

// What a replay shows of lights and frames now, in the form of a live status.
function replayedStatus() {
  const { head, nowS } = app;
  const lanes = head.lanes.map(({ lights, frame_lists, frame_list_s }) => ({
    lights: lights.findLast(([atS]) => atS <= nowS)?.[1] ?? [],
    frames: frame_lists[Math.min(Math.floor(nowS / frame_list_s), frame_lists.length - 1)],
    failure: "",
  }));
  return { lanes, programs: [], recording_s: null, recorded: [] };
}

let last = performance.now(), readS = 0;
function frame(now) {
  const elapsedS = Math.min((now - last) / 1000, 0.25);
  last = now;
  app.player?.advance(elapsedS);
  drive.step(elapsedS, now);
  if (app.hasMoved && app.lanes.length) {
    const { nowS } = app;
    if (Math.abs(nowS - readS) >= READ_S) chooseUnit(nowS);
    const { isTouched } = app;
    app.hasMoved = app.isTouched = false;
    scene.draw(nowS);
    if (!byId("charts").hidden && (isTouched || charts.isDue(nowS))) charts.draw(nowS);
    if (isTouched || Math.abs(nowS - readS) >= READ_S) {
      readS = nowS;
      figures.draw(nowS);
      gauges.draw(nowS);
      setText(byId("clock"), `${nowS.toFixed(1)} s`);
    }
    if (app.player) {
      app.player.draw();
      app.status = replayedStatus();
      drawStatus();
    }
    app.drawn++;
  } else if (app.isTouched) {
    app.isTouched = false;
    scene.drawNothing(app.head?.is_own ? "the programs are starting" : "");
  }
  requestAnimationFrame(frame);
}

function toast(text) {
  setText(byId("toast"), text);
  byId("toast").hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => (byId("toast").hidden = true), TOAST_MS);
}

function startLive() {
  app.link = new Link({
    hello(head) {
      take(head);
      const names = head.signals.map((signal) => signal.name);
      app.lanes = head.lanes.map(() => Rows.live(names, head.row_period_s));
      app.lost = [];
      build();
      buildControls();
      drive.build();
    },
    rows(lane, batch) {
      app.lanes[lane]?.take(batch);
      if (app.heldS === null) app.moveOn();
    },
    status(status) {
      app.status = status;
      if (app.head) drawStatus();
    },
    refusal: toast,
    state(isOpen) {
      setText(byId("connection"), isOpen ? "" : "connection lost; waiting for the cockpit …");
    },
  });
}

function startReplay({ head, lanes }) {
  take(head);
  app.lanes = lanes;
  app.player = new Player(app, head.duration_s);
  byId("hold").hidden = true;
  byId("controls").hidden = true;
  document.body.className = "replay";
  setText(byId("bus"), `${head.bus}; ${(1 / head.row_period_s).toFixed(0)} rows a second, RMS and peak of every frame`);
  build();
}

function hold() {
  if (app.player) {
    app.player.toggle();
    return;
  }
  app.heldS = app.heldS === null ? app.nowS : null;
  pressed(byId("hold"), app.heldS !== null);
  app.touch();
}

function tab(name) {
  for (const one of ["charts", "frames"]) {
    byId(one).hidden = one !== name;
    byId(`tab-${one}`).setAttribute("aria-selected", String(one === name));
  }
  byId("span-tools").hidden = name !== "charts";
  drawStatus();
  app.touch();
}

const toggleTheme = startTheme(build);
byId("hold").onclick = hold;
byId("tab-charts").onclick = () => tab("charts");
byId("tab-frames").onclick = () => tab("frames");
const press = (id) => () => byId(id)?.click();
startKeys({
  " ": ["hold the picture; play or pause a replay", hold],
  "ArrowLeft": ["one second back in a replay", () => app.player?.step(-1)],
  "ArrowRight": ["one second on in a replay", () => app.player?.step(1)],
  "+": ["nearer", press("zoom-in")], "-": ["farther", press("zoom-out")],
  "[": ["shorter charts", press("span-less")], "]": ["longer charts", press("span-more")],
  "d": ["deviation ×1 or ×10", press("deviation")], "o": ["whole path", press("overview")],
  "f": ["charts or frames", () => tab(byId("charts").hidden ? "charts" : "frames")],
  "g": ["gust", press("gust")], "s": ["steering offset", press("offset")], "i": ["ice", press("ice")],
  "r": ["record", press("record")], "t": ["dark or light", toggleTheme],
  ...Object.fromEntries([1, 2, 3, 4].map((lane) => [String(lane), ["", () => app.selectLane(lane - 1)]])),
});
window.cockpit = app; // for a look at the page from outside
const recording = await readRecording();
if (recording) startReplay(recording);
else startLive();
requestAnimationFrame(frame);

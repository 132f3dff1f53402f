// Rounds of a minute in which the visitor steers: the steering wheel and the score.

import { Hand } from "cockpit/hand.js";
import { colour } from "cockpit/theme.js";
import { byId, element, length, setText } from "cockpit/words.js";

const ROUND_S = 60;
const COUNTDOWN_MS = 3000;
const SEND_MS = 20;
const STEERING_RATIO = 16; // of the steering wheel in the picture to the front wheels
const LOCK_M_S2 = 3.5; // lateral acceleration at the stop, a little beyond what the steering allows
const LOCK_RAD = 0.5;
const SPEEDS_KM_H = [20, 30, 40];
const CYCLES_MS = [1, 5, 10, 20];
const FULL_N_M = 10; // of torque: a quarter of the rim
const SLOW = 0.05; // share of the newest torque in its mean; what is faster is felt as vibration

export class Drive {
  constructor(app) {
    this.app = app;
    this.wheel = element("canvas", { id: "wheel", width: 400, height: 400, role: "img", ariaLabel: "steering wheel; drag it to steer" });
    this.hand = new Hand(this.wheel);
    this.text = element("p", { id: "story", role: "status" });
    this.score = element("p", { id: "score" });
    this.speed = element("select", { id: "drive-speed", ariaLabel: "speed", onchange: () => this.restart() },
      ...SPEEDS_KM_H.map((speed) => element("option", { value: speed }, `${speed} km/h`)));
    this.grip = element("select", { id: "grip", ariaLabel: "grip" });
    this.cycle = element("select", { id: "wheel-cycle", ariaLabel: "cycle of the hand wheel", onchange: () => this.restart() },
      ...CYCLES_MS.map((cycle) => element("option", { value: cycle }, `cycle ${cycle} ms`)));
    this.meanN = 0;
    this.again = element("button", { type: "button", id: "again", onclick: () => this.restart() }, "Again");
    this.onward = element("button", { type: "button", id: "next", className: "primary", onclick: () => this.next("") }, "Next round");
    this.full = element("button", { type: "button", id: "kiosk", onclick: () => this.toggleKiosk() }, "Full screen");
    this.home = element("a", { className: "download", href: "recording/lane1.html", download: "round.html", hidden: true }, "Take your round home");
    const buttons = element("div", { className: "row" }, this.speed, this.grip, this.cycle, this.again, this.onward, this.full);
    byId("drive").append(this.wheel, element("div", {}, this.text, this.score, buttons, this.home));
    document.addEventListener("fullscreenchange", () => {
      if (!document.fullscreenElement) this.setKiosk(false);
    });
    this.sentMs = 0;
    this.result = ""; // of the round before
    if (location.hash === "#kiosk") this.setKiosk(true);
  }

  get isKiosk() {
    return document.body.classList.contains("kiosk");
  }

  get rounds() {
    return this.app.head?.choices?.scenarios.filter((one) => one.is_round) ?? [];
  }

  // The lane that the visitor steers, −1 where a law does.
  get lane() {
    return this.scenario?.controllers.findIndex((name) => name === "hand" || isWheel(name)) ?? -1;
  }

  // Whether he steers by a hand wheel with force feedback.
  get feels() {
    return isWheel(this.scenario?.controllers[this.lane]);
  }

  // Begin with what runs now: a new scenario, or the page has just been opened.
  build() {
    this.scenario = this.app.head.scenario;
    const isShown = this.lane >= 0 || Boolean(this.scenario?.is_round);
    byId("drive").hidden = !isShown;
    this.app.isDriven = isShown;
    document.body.classList.toggle("driven", isShown);
    this.startS = this.goMs = null;
    if (!this.app.lanes.length) this.hand.letGo(); // who takes the wheel while the programs start has it
    if (!isShown) {
      if (this.scenario && this.isKiosk) this.start(this.rounds[0]);
      return;
    }
    this.speed.value = this.scenario.speed_km_h;
    this.speed.hidden = !SPEEDS_KM_H.includes(this.scenario.speed_km_h);
    this.grip.hidden = this.cycle.hidden = !this.feels;
    this.cycle.value = this.scenario.wheel_cycle_ms;
    if (!this.grip.children.length) {
      this.grip.append(...this.app.head.choices.grips.map((grip) => element("option", { value: grip }, grip.replaceAll("_", " "))));
      this.grip.value = "light";
    }
    if (this.app.lanes.length) this.hand.stopRad = STEERING_RATIO * this.lockRad;
    setText(this.again, this.lane < 0 ? "Watch again" : "Again");
    this.tell();
  }

  tell() {
    const how = this.lane < 0 ? "" : " Press ← or → to begin, drag the wheel, or take a gamepad.";
    const waits = [this.result, this.scenario.note + how].filter(Boolean).join(" ");
    setText(this.text, this.startS === null ? waits : this.scenario.note);
  }

  start(scenario, result = "") {
    this.result = result;
    const speed_km_h = this.scenario?.is_round && !this.speed.hidden ? Number(this.speed.value) : scenario.speed_km_h;
    const wheel_cycle_ms = this.feels ? Number(this.cycle.value) : scenario.wheel_cycle_ms;
    this.app.wish({ do: "record", on: false });
    this.app.wish({ do: "start", scenario: { ...scenario, speed_km_h, wheel_cycle_ms } });
    this.scenario = null; // until the new one runs
  }

  restart() {
    if (this.scenario) this.start(this.scenario);
  }

  next(result) {
    const titles = this.rounds.map((one) => one.title);
    this.start(this.rounds[(titles.indexOf(this.scenario?.title) + 1) % titles.length], result);
  }

  // The car is far off, and is put back: the round begins again and this one does not count.
  lose() {
    if (!this.scenario || this.feels) return; // a wheel that no one holds steers anywhere
    const drivenS = this.startS === null ? 0 : Math.round(this.app.nowS - this.startS);
    this.result = `The car was lost after ${drivenS} s; this round does not count.`;
    this.app.wish({ do: "record", on: false });
    this.startS = this.goMs = null;
    this.hand.letGo();
    this.tell();
  }

  // For the next visitor, when no one has taken the wheel for a minute.
  welcome() {
    this.start(this.rounds[0]);
  }

  toggleKiosk() {
    const isOn = !this.isKiosk;
    this.setKiosk(isOn);
    if (isOn) document.documentElement.requestFullscreen?.().catch(() => {}); // a phone may have none
    else if (document.fullscreenElement) document.exitFullscreen();
  }

  setKiosk(isOn) {
    document.body.classList.toggle("kiosk", isOn);
    setText(this.full, isOn ? "Leave" : "Full screen");
  }

  // Once a picture: move the hand, report it, run the minute.
  step(elapsedS, nowMs) {
    if (byId("drive").hidden || !this.scenario) return;
    this.hand.step(elapsedS);
    const { nowS } = this.app;
    const lane = Math.max(this.lane, 0), rows = this.app.lanes[lane];
    const isThere = Number.isFinite(rows?.value("lateral_error_m", nowS)) && !this.app.lost[lane];
    const isDriver = this.lane >= 0 && this.hand.isOn;
    if (isThere && isDriver) this.goMs ??= nowMs + COUNTDOWN_MS;
    const isGo = this.lane < 0 || (this.goMs !== null && nowMs >= this.goMs);
    const isHeld = !this.feels || this.grip.value !== "hands_off";
    if (isDriver && isGo && isHeld && nowMs - this.sentMs >= SEND_MS) {
      this.sentMs = nowMs;
      this.app.wish({ do: "steer", steer_rad: this.steerRad, grip: this.grip.value || "light" });
    }
    if (this.feels) this.vibrate(rows?.value("feedback_torque_n_m", nowS));
    // The minute begins with the first command on the bus: the hand's process takes seconds to start.
    const isSteered = Number.isFinite(rows?.value(this.feels ? "hand_wheel_rad" : "steer_rad", nowS));
    if (this.startS === null && isThere && isGo && isSteered) this.begin(nowS);
    this.drawWheel(nowS);
    if (this.feels && isThere && !isHeld) setText(this.score, this.felt);
    else if (this.startS !== null) this.count(nowS - this.startS);
    else setText(this.score, this.wait(isThere, isDriver, nowMs));
    if (this.startS === null && this.isKiosk && nowS > ROUND_S && this.scenario.title !== this.rounds[0].title) this.welcome();
  }

  // What a visitor waits for.
  wait(isThere, isDriver, nowMs) {
    if (!isThere) return isDriver ? "You have the wheel; the car is being started" : "The car is being started";
    if (this.goMs === null) return this.lane < 0 ? "" : "The car is ready";
    return nowMs < this.goMs ? String(Math.ceil((this.goMs - nowMs) / 1000)) : "Go";
  }

  get lockRad() {
    const speed = this.scenario.speed_km_h / 3.6;
    const { front_axle_m, rear_axle_m } = this.app.head.lanes[0];
    return Math.min(LOCK_RAD, (LOCK_M_S2 * (front_axle_m + rear_axle_m)) / speed ** 2);
  }

  get steerRad() {
    return this.hand.position * this.lockRad;
  }

  begin(nowS) {
    this.startS = nowS;
    this.app.wish({ do: "reset" });
    if (this.lane >= 0) {
      this.home.hidden = true; // until this round, which takes the place of the last one, is over
      this.app.wish({ do: "record", on: true });
    }
    this.tell();
  }

  count(drivenS) {
    const { rms_m, in_lane } = this.app.status?.lanes[Math.max(this.lane, 0)]?.score ?? {};
    if (rms_m == null) return;
    const left = Math.max(Math.ceil(ROUND_S - drivenS), 0);
    const result = `RMS ${length(rms_m, true)} · in lane ${(100 * in_lane).toFixed(0)}\u00a0%`;
    setText(this.score, `${left} s · ${result}`);
    if (left) return;
    if (this.lane >= 0) this.home.hidden = false;
    this.next(`That minute: ${result}.`);
  }

  // Whether the wheel of each lane shakes.
  get felt() {
    const lanes = this.app.status?.lanes ?? [];
    return lanes.map(({ hand_wheel }, lane) => `${this.app.head.lanes[lane].label}: ${hand_wheel || "not heard yet"}`).join(" · ");
  }

  // A gamepad shakes with what is fast in the torque, where the browser lets it.
  vibrate(torqueN) {
    if (!Number.isFinite(torqueN)) return;
    this.meanN += SLOW * (torqueN - this.meanN);
    const strongMagnitude = Math.min(Math.abs(torqueN - this.meanN) / 3, 1);
    if (strongMagnitude < 0.05) return;
    for (const pad of navigator.getGamepads?.() ?? []) {
      pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: 50, strongMagnitude, weakMagnitude: 0 }).catch(() => {});
    }
  }

  // The rim turns with the hand; the mark on it is where the wheels of the car are.
  drawWheel(nowS) {
    const pen = this.wheel.getContext("2d");
    const rows = this.app.lanes[Math.max(this.lane, 0)];
    if (!rows) return;
    const handRad = this.feels ? rows.value("hand_wheel_rad", nowS) / STEERING_RATIO : this.lane < 0 ? rows.value("steer_rad", nowS) : this.steerRad;
    const carRad = rows.value("wheel_angle_rad", nowS);
    pen.setTransform(1, 0, 0, 1, 200, 200);
    pen.clearRect(-200, -200, 400, 400);
    pen.rotate(-STEERING_RATIO * (handRad || 0));
    pen.lineCap = "round";
    for (const [ink, width] of [["body", 34], ["glass", 22]]) {
      pen.strokeStyle = colour(ink);
      pen.lineWidth = width;
      pen.beginPath();
      pen.arc(0, 0, 160, 0, 2 * Math.PI);
      for (const [x, y] of [[-150, 20], [150, 20], [0, 150]]) {
        pen.moveTo(0, 20);
        pen.lineTo(x, y);
      }
      pen.stroke();
    }
    mark(pen, colour("wanted"), -160);
    if (this.feels) this.drawTorques(pen, rows, nowS);
    if (!Number.isFinite(carRad)) return;
    pen.setTransform(1, 0, 0, 1, 200, 200);
    pen.rotate(-STEERING_RATIO * carRad);
    mark(pen, colour("applied"), -185);
  }

  // Two bows from the top: the driver's torque on the rim, the feedback's inside of it.
  drawTorques(pen, rows, nowS) {
    pen.setTransform(1, 0, 0, 1, 200, 200);
    pen.lineWidth = 10;
    for (const [name, ink, radius] of [["driver_torque_n_m", "wanted", 192], ["feedback_torque_n_m", "applied", 128]]) {
      const sweepRad = ((rows.value(name, nowS) || 0) / FULL_N_M) * (Math.PI / 2);
      pen.strokeStyle = colour(ink);
      pen.beginPath();
      pen.arc(0, 0, radius, -Math.PI / 2, -Math.PI / 2 - sweepRad, sweepRad > 0);
      pen.stroke();
    }
  }
}

function isWheel(name) {
  return name?.startsWith("hand_wheel") ?? false;
}

function mark(pen, ink, y) {
  pen.fillStyle = ink;
  pen.beginPath();
  pen.arc(0, y, 14, 0, 2 * Math.PI);
  pen.fill();
}

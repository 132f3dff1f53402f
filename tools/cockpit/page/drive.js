// Rounds of a minute in which the visitor steers: the steering wheel and the score.

import { Felt } from "cockpit/felt.js";
import { Hand } from "cockpit/hand.js";
import { colour } from "cockpit/theme.js";
import { byId, element, length, setText, slider } from "cockpit/words.js";

const ROUND_S = 60;
const COUNTDOWN_MS = 3000;
const SEND_MS = 20;
const STEERING_RATIO = 16; // of the steering wheel in the picture to the front wheels
const LOCK_M_S2 = 3.5; // lateral acceleration at the stop, a little beyond what the steering allows
const LOCK_RAD = 0.5;
const SPEEDS_KM_H = [20, 30, 40];
const DRIVEN_M_S2 = 8; // the same where the visitor drives: the tyres are the limit
const PEDAL_M_S2 = 5; // how fast the accelerator changes the speed that is asked for
const LEAD_M_S = 8; // how far that is from the speed of the car at most; a pressed brake goes there at once
const FULL_N_M = 10; // of torque: a quarter of the rim

export class Drive {
  constructor(app) {
    this.app = app;
    this.wheel = element("canvas", { id: "wheel", width: 400, height: 400, role: "img", ariaLabel: "steering wheel; drag it to steer" });
    this.hand = new Hand(this.wheel);
    this.text = element("p", { id: "story", role: "status" });
    this.score = element("p", { id: "score" });
    this.speed = element("select", { id: "drive-speed", ariaLabel: "speed", onchange: () => this.restart() },
      ...SPEEDS_KM_H.map((speed) => element("option", { value: speed }, `${speed} km/h`)));
    this.car = element("select", { id: "car", ariaLabel: "car", onchange: () => this.restart() });
    this.pedals = slider("Speed", "felt-speed", [0, 130, 1], (speed) => `${speed} km/h`, (speed) => (this.askedM_s = speed / 3.6));
    this.felt = new Felt(app, () => this.restart());
    this.felt.choice.after(this.pedals.box);
    this.askedM_s = 0;
    this.again = element("button", { type: "button", id: "again", onclick: () => this.restart() }, "Again");
    this.onward = element("button", { type: "button", id: "next", className: "primary", onclick: () => this.next("") }, "Next round");
    this.full = element("button", { type: "button", id: "kiosk", onclick: () => this.toggleKiosk() }, "Full screen");
    this.home = element("a", { className: "download", href: "recording/lane1.html", download: "round.html", hidden: true }, "Take your round home");
    const buttons = element("div", { className: "row" }, this.car, this.speed, this.again, this.onward, this.full);
    byId("drive").append(this.wheel, element("div", {}, this.text, this.felt.line, this.score, buttons, this.home), this.felt.box);
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

  // Whether he sets the speed.
  get drives() {
    return this.lane >= 0 && this.scenario.driven_to_km_h !== null;
  }

  // Begin with what runs now: a new scenario, or the page has just been opened.
  build() {
    const before = this.scenarioBefore;
    this.scenario = this.app.head.scenario;
    this.scenarioBefore = this.scenario?.title;
    const isShown = this.lane >= 0 || Boolean(this.scenario?.is_round);
    byId("drive").hidden = !isShown;
    this.app.isDriven = isShown;
    document.body.classList.toggle("driven", isShown);
    this.startS = this.goMs = null;
    this.ask(0);
    if (!this.app.lanes.length) this.hand.letGo(); // who takes the wheel while the programs start has it
    if (!isShown) {
      if (this.scenario && this.isKiosk) this.start(this.rounds[0]);
      return;
    }
    this.speed.value = this.scenario.speed_km_h;
    this.speed.hidden = this.drives || !SPEEDS_KM_H.includes(this.scenario.speed_km_h);
    this.pedals.box.hidden = !this.drives;
    this.pedals.input.max = this.scenario.driven_to_km_h;
    this.hand.hasPedals = this.drives;
    this.hand.keysPerS = this.drives ? 0.6 : 1.6;
    this.car.hidden = !this.drives || this.scenario.plants.length > 0;
    this.car.replaceChildren(...this.app.head.choices.cars.map((car) => element("option", { value: car, selected: car === this.scenario.plant }, car.replaceAll("_", " "))));
    this.felt.build(this.scenario, this.lane, this.feels, this.scenario.title !== before);
    if (this.app.lanes.length) this.hand.stopRad = STEERING_RATIO * this.lockRad;
    setText(this.again, this.lane < 0 ? "Watch again" : "Again");
    this.tell();
  }

  tell() {
    const how = this.lane < 0 ? "" : ` Press ${this.drives ? "↑" : "← or →"} to begin, drag the wheel, or take a gamepad.`;
    const waits = [this.result, this.scenario.note + how].filter(Boolean).join(" ");
    setText(this.text, this.startS === null ? waits : this.scenario.note);
  }

  start(scenario, result = "") {
    this.result = result;
    const speed_km_h = this.scenario?.is_round && !this.speed.hidden ? Number(this.speed.value) : scenario.speed_km_h;
    const isSame = scenario.title === this.scenario?.title;
    const wheel_cycle_ms = isSame && this.feels ? this.felt.cycleMs : scenario.wheel_cycle_ms;
    const plant = isSame && this.drives ? this.car.value : scenario.plant;
    this.app.wish({ do: "record", on: false });
    this.app.wish({ do: "start", scenario: { ...scenario, speed_km_h, wheel_cycle_ms, plant } });
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
  lose(grip) {
    this.ask(0);
    if (!this.scenario || this.feels) return; // a wheel that no one holds steers anywhere
    const drivenS = this.startS === null ? 0 : Math.round(this.app.nowS - this.startS);
    this.result = `The car was lost after ${drivenS} s; this round does not count${grip && `: ${grip}`}.`;
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
    if (this.drives) this.pedal(this.hand.pedal, elapsedS);
    if (this.app.lanes.length) this.hand.stopRad = STEERING_RATIO * this.lockRad;
    const lane = Math.max(this.lane, 0), rows = this.app.lanes[lane];
    const isThere = Number.isFinite(rows?.value("lateral_error_m", nowS)) && !this.app.lost[lane];
    const isDriver = this.lane >= 0 && this.hand.isOn;
    if (isThere && isDriver) this.goMs ??= nowMs + COUNTDOWN_MS;
    const isGo = this.lane < 0 || (this.goMs !== null && nowMs >= this.goMs);
    if (isDriver && isGo && nowMs - this.sentMs >= SEND_MS) {
      this.sentMs = nowMs;
      this.app.wish({ do: "steer", steer_rad: this.steerRad, grip: this.felt.grip ?? "light", speed_m_s: this.askedM_s, wheel: this.felt.wheel });
    }
    if (this.feels) this.felt.step(elapsedS, nowS, rows, this.hand.position);
    // The minute begins with the first command on the bus: the hand's process takes seconds to start.
    const isSteered = Number.isFinite(rows?.value(this.feels ? "hand_wheel_rad" : "steer_rad", nowS));
    if (this.startS === null && isThere && isGo && isSteered) this.begin(nowS);
    this.drawWheel(nowS);
    if (this.startS !== null) this.count(nowS - this.startS);
    else setText(this.score, this.wait(isThere, isDriver, nowMs));
    if (this.startS === null && this.isKiosk && nowS > ROUND_S && this.scenario.title !== this.rounds[0].title) this.welcome();
  }

  // What a visitor waits for.
  wait(isThere, isDriver, nowMs) {
    if (!isThere) return isDriver ? "You have the wheel; the car is being started" : "The car is being started";
    if (this.goMs === null) return this.lane < 0 ? "" : "The car is ready";
    return nowMs < this.goMs ? String(Math.ceil((this.goMs - nowMs) / 1000)) : "Go";
  }

  // Ask for a speed.
  ask(speedM_s) {
    this.askedM_s = Math.min(Math.max(speedM_s, 0), (this.scenario?.driven_to_km_h ?? 0) / 3.6);
    this.pedals.set(3.6 * this.askedM_s);
  }

  // Accelerator 1, brake −1: the speed that is asked for moves, near that of the car.
  pedal(pedal, elapsedS) {
    const now = this.speedM_s, before = Math.max(this.askedM_s, now);
    if (pedal > 0) this.ask(Math.min(before + pedal * PEDAL_M_S2 * elapsedS, Math.max(before, now + LEAD_M_S)));
    if (pedal < 0) this.ask(Math.min(this.askedM_s, now + pedal * LEAD_M_S));
  }

  // Of the car, 0 before it is there.
  get speedM_s() {
    return this.app.lanes[Math.max(this.lane, 0)]?.value("speed_m_s", this.app.nowS) || 0;
  }

  get lockRad() {
    const speed = this.drives ? this.speedM_s : this.scenario.speed_km_h / 3.6;
    const { front_axle_m, rear_axle_m } = this.app.head.lanes[0];
    return Math.min(LOCK_RAD, ((this.drives ? DRIVEN_M_S2 : LOCK_M_S2) * (front_axle_m + rear_axle_m)) / speed ** 2);
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
    const shaken = this.feels && !this.drives ? ` · shaken ${this.felt.shakenS.toFixed(0)} s` : "";
    const result = `RMS ${length(rms_m, true)} · in lane ${(100 * in_lane).toFixed(0)}\u00a0%${shaken}`;
    if (!this.scenario.is_round) return setText(this.score, result);
    setText(this.score, `${left} s · ${result}`);
    if (left) return;
    if (this.lane >= 0) this.home.hidden = false;
    this.next(`That minute: ${result}.`);
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

// Rounds of a minute in which the visitor steers: the steering wheel and the score.

import { Hand } from "cockpit/hand.js";
import { colour } from "cockpit/theme.js";
import { byId, element, setText } from "cockpit/words.js";

const ROUND_S = 60;
const SEND_MS = 20;
const STEERING_RATIO = 16; // of the steering wheel in the picture to the front wheels
const LOCK_M_S2 = 3.5; // lateral acceleration at the stop, a little beyond what the steering allows
const LOCK_RAD = 0.5;
const SPEEDS_KM_H = [20, 30, 40];

export class Drive {
  constructor(app) {
    this.app = app;
    this.wheel = element("canvas", { id: "wheel", width: 400, height: 400, role: "img", ariaLabel: "steering wheel; drag it to steer" });
    this.hand = new Hand(this.wheel);
    this.text = element("p", { id: "story", role: "status" });
    this.score = element("p", { id: "score" });
    this.speed = element("select", { id: "drive-speed", ariaLabel: "speed", onchange: () => this.restart() },
      ...SPEEDS_KM_H.map((speed) => element("option", { value: speed }, `${speed} km/h`)));
    this.again = element("button", { type: "button", id: "again", onclick: () => this.restart() }, "Again");
    this.onward = element("button", { type: "button", id: "next", className: "primary", onclick: () => this.next() }, "Next round");
    this.full = element("button", { type: "button", id: "kiosk", onclick: () => this.toggleKiosk() }, "Full screen");
    this.home = element("a", { className: "download", href: "recording/lane1.html", download: "round.html", hidden: true }, "Take your round home");
    const buttons = element("div", { className: "row" }, this.speed, this.again, this.onward, this.full);
    byId("drive").append(this.wheel, element("div", {}, this.text, this.score, buttons, this.home));
    document.addEventListener("fullscreenchange", () => {
      if (!document.fullscreenElement) this.setKiosk(false);
    });
    this.sentMs = 0;
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
    return this.scenario?.controllers.indexOf("hand") ?? -1;
  }

  // Begin with what runs now: a new scenario, or the page has just been opened.
  build() {
    this.scenario = this.app.head.scenario;
    const isShown = this.lane >= 0 || Boolean(this.scenario?.is_round);
    byId("drive").hidden = !isShown;
    this.app.isDriven = isShown;
    document.body.classList.toggle("driven", isShown);
    this.startS = null;
    this.hand.letGo();
    if (!isShown) {
      if (this.scenario && this.isKiosk) this.start(this.rounds[0]);
      return;
    }
    this.speed.value = this.scenario.speed_km_h;
    this.hand.stopRad = STEERING_RATIO * this.lockRad;
    setText(this.again, this.lane < 0 ? "Watch again" : "Again");
    this.tell();
  }

  tell() {
    const how = this.lane < 0 ? "" : " Take the wheel: ← →, drag it, or a gamepad.";
    setText(this.text, this.scenario.note + (this.startS === null ? how : ""));
  }

  start(scenario) {
    const speed_km_h = this.scenario?.is_round ? Number(this.speed.value) : scenario.speed_km_h;
    this.app.wish({ do: "record", on: false });
    this.app.wish({ do: "start", scenario: { ...scenario, speed_km_h } });
    this.scenario = null; // until the new one runs
  }

  restart() {
    if (this.scenario) this.start(this.scenario);
  }

  next() {
    const titles = this.rounds.map((one) => one.title);
    this.start(this.rounds[(titles.indexOf(this.scenario?.title) + 1) % titles.length]);
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
    const isDriver = this.lane >= 0 && this.hand.isOn;
    if (isDriver && nowMs - this.sentMs >= SEND_MS) {
      this.sentMs = nowMs;
      this.app.wish({ do: "steer", steer_rad: this.steerRad });
    }
    // The minute begins with the first command on the bus: the hand's process takes seconds to start.
    const isSteered = Number.isFinite(this.app.lanes[Math.max(this.lane, 0)]?.value("steer_rad", nowS));
    if (this.startS === null && isSteered) this.begin(nowS);
    this.drawWheel(nowS);
    if (this.startS !== null) this.count(nowS - this.startS);
    else if (isDriver) setText(this.score, "The wheel is being connected");
    else if (this.isKiosk && nowS > ROUND_S && this.scenario.title !== this.rounds[0].title) this.welcome();
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
    const result = `RMS ${told(rms_m, in_lane)}`;
    setText(this.score, left ? `${left} s · ${result}` : `That minute: ${result}`);
    if (left) return;
    if (this.lane >= 0) this.home.hidden = false;
    this.next();
  }

  // The rim turns with the hand; the mark on it is where the wheels of the car are.
  drawWheel(nowS) {
    const pen = this.wheel.getContext("2d");
    const rows = this.app.lanes[Math.max(this.lane, 0)];
    if (!rows) return;
    const handRad = this.lane < 0 ? rows.value("steer_rad", nowS) : this.steerRad;
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
    if (!Number.isFinite(carRad)) return;
    pen.setTransform(1, 0, 0, 1, 200, 200);
    pen.rotate(-STEERING_RATIO * carRad);
    mark(pen, colour("applied"), -185);
  }
}

// A score in words that do not break: "46 m · in lane 21 %".
function told(rms_m, in_lane) {
  const rms = rms_m < 10 ? `${(1000 * rms_m).toFixed(0)}\u00a0mm` : `${rms_m.toFixed(0)}\u00a0m`;
  return `${rms} · in lane ${(100 * in_lane).toFixed(0)}\u00a0%`;
}

function mark(pen, ink, y) {
  pen.fillStyle = ink;
  pen.beginPath();
  pen.arc(0, y, 14, 0, 2 * Math.PI);
  pen.fill();
}

// What is felt at a hand wheel: its sliders, the moment at which it shakes, the gamepad's vibration.

import { byId, element, pressed, setText, slider } from "cockpit/words.js";

const CYCLES_MS = [1, 5, 10, 20];
const WHEELS = { hand_wheel: "force as it arrives", hand_wheel_damped: "with damping", hand_wheel_cdob: "with the CDOB" };
const DELAY_MS_MAX = 200, ROAD_MIN = 30;
const JUDGED_S = 6; // of motion: who turned the wheel in it shook it himself
const SURE_S = 4; // of shaking: a bump that dies away looks like it for half of that window
const SLOW = 0.05; // share of the newest torque in its mean; what is faster is felt as vibration
const FULL_N_M = 3; // of vibration

export class Felt {
  // restart: called when the hand wheel has to start again
  constructor(app, restart) {
    this.app = app;
    this.meanN = 0;
    this.line = element("p", { id: "felt", role: "status" });
    this.delay = slider("Delay", "felt-delay", [0, DELAY_MS_MAX, 5], (ms) => `2 × ${ms} ms`, (ms) => this.send(ms));
    this.cycle = slider("Cycle", "felt-cycle", [0, CYCLES_MS.length - 1, 1], (at) => `${CYCLES_MS[at]} ms`, () => {}, { onchange: restart });
    this.hands = slider("Hands", "felt-hands", [0, 3, 1], (at) => this.gripAt(at), () => {});
    this.road = slider("Road grip", "felt-road", [ROAD_MIN, 100, 5], (share) => `${share} %`, (share) => app.network.setFriction(share / 100));
    this.laws = Object.entries(WHEELS).map(([name, label]) => element("button", { type: "button", id: `felt-${name}`, onclick: () => this.choose(name) }, label));
    this.choice = element("div", { className: "row", role: "group", ariaLabel: "feedback" }, ...this.laws);
    this.box = element("div", { id: "felt-tools" }, this.choice, this.delay.box, this.cycle.box, this.hands.box, this.road.box);
  }

  // isNew: a scenario that is not the one before again
  build(scenario, lane, isOn, isNew) {
    this.box.hidden = this.line.hidden = !isOn;
    this.lane = lane;
    this.saidS = this.sinceS = this.stillS = null;
    this.shakenS = this.movedS = this.position = 0;
    if (!isOn) return;
    this.choice.hidden = scenario.controllers.length > 1;
    this.delay.set(1000 * scenario.downlink.mean_s);
    this.cycle.set(CYCLES_MS.indexOf(scenario.wheel_cycle_ms));
    this.road.set(100);
    if (!isNew) return;
    this.hands.set(this.app.head.choices.grips.indexOf(scenario.grip));
    this.choose(scenario.controllers[lane]);
  }

  gripAt(at) {
    return (this.app.head?.choices?.grips[at] ?? "").replaceAll("_", " ");
  }

  get grip() {
    return this.app.head.choices.grips[this.hands.input.value];
  }

  get cycleMs() {
    return CYCLES_MS[this.cycle.input.value];
  }

  // Empty where each lane has a hand wheel of its own.
  get wheel() {
    return this.choice.hidden || this.box.hidden ? "" : this.chosen;
  }

  choose(name) {
    this.chosen = name;
    this.laws.forEach((button) => pressed(button, button.id === `felt-${name}`));
  }

  // As if the sliders of both directions were moved.
  send(delayMs) {
    for (const direction of ["downlink", "uplink"]) {
      const input = byId(`${direction}-mean_s`);
      input.value = delayMs;
      input.dispatchEvent(new Event("input"));
    }
  }

  // Once a picture; position: of the visitor's hand.
  step(elapsedS, nowS, rows, position) {
    if (position !== this.position) this.movedS = nowS;
    this.position = position;
    this.vibrate(rows?.value("feedback_torque_n_m", nowS));
    const texts = (this.app.status?.lanes ?? []).map(({ hand_wheel }) => hand_wheel);
    if (!texts[this.lane]) return setText(this.line, "");
    const isJudged = this.grip === "hands_off" || nowS - this.movedS > JUDGED_S;
    this.saidS = isJudged && texts[this.lane].startsWith("shakes") ? (this.saidS ?? nowS) : null;
    const isShaking = this.saidS !== null && nowS - this.saidS > SURE_S;
    this.line.className = isShaking ? "bad" : "";
    if (isShaking) this.shakenS += elapsedS;
    setText(this.line, isJudged ? this.verdict(isShaking, nowS, texts) : "You turn the wheel: hold it still to see whether it shakes");
  }

  verdict(isShaking, nowS, texts) {
    if (texts.length > 1) return texts.map((text, lane) => `${this.app.head.lanes[lane].label}: ${text}`).join(" · ");
    const where = `at ${this.delay.input.value} ms each way, ${WHEELS[this.chosen]}`;
    if (isShaking) {
      this.sinceS ??= this.saidS;
      this.stillS = null;
      return `The wheel ${texts[0].replace("shakes", "has begun to shake")}, ${where}: since ${Math.floor(this.sinceS)} s`;
    }
    if (this.sinceS !== null) this.stillS ??= nowS;
    this.sinceS = null;
    return `The wheel is still, ${where}${this.stillS === null ? "" : `: again since ${Math.floor(this.stillS)} s`}`;
  }

  // A gamepad shakes with what is fast in the torque, where the browser lets it.
  vibrate(torqueN) {
    if (!Number.isFinite(torqueN)) return;
    this.meanN += SLOW * (torqueN - this.meanN);
    const strongMagnitude = Math.min(Math.abs(torqueN - this.meanN) / FULL_N_M, 1);
    if (strongMagnitude < 0.05) return;
    for (const pad of navigator.getGamepads?.() ?? []) {
      pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: 50, strongMagnitude, weakMagnitude: 0 }).catch(() => {});
    }
  }
}

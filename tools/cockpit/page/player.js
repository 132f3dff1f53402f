// The time line of a replay: where it is, whether it runs, how fast.

import { byId, element, setText } from "cockpit/words.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10];
const STEP_S = 1;

export class Player {
  constructor(app, durationS) {
    this.app = app;
    this.durationS = durationS;
    this.nowS = 0;
    this.speed = 1;
    this.isRunning = true;
    this.build();
  }

  build() {
    this.button = element("button", { type: "button", id: "play", title: "Play or pause (space)", onclick: () => this.toggle() }, "Pause");
    this.line = element("input", { type: "range", id: "seek", min: 0, max: this.durationS, step: 0.01, value: 0, ariaLabel: "time of the replay in seconds", oninput: () => this.seek(this.line.valueAsNumber) });
    const speeds = SPEEDS.map((speed) => element("option", { value: speed, selected: speed === 1 }, `×${speed}`));
    this.choice = element("select", { id: "speed", ariaLabel: "speed of the replay", onchange: () => (this.speed = Number(this.choice.value)) }, ...speeds);
    this.text = element("span", {}, "");
    byId("timeline").replaceChildren(this.button, this.line, this.text, this.choice);
    byId("timeline").hidden = false;
  }

  toggle() {
    if (!this.isRunning && this.nowS >= this.durationS) this.nowS = 0;
    this.isRunning = !this.isRunning;
    setText(this.button, this.isRunning ? "Pause" : "Play");
    this.app.touch();
  }

  seek(timeS) {
    this.moveTo(timeS);
    this.app.touch();
  }

  moveTo(timeS) {
    this.nowS = Math.min(Math.max(timeS, 0), this.durationS);
    this.app.moveOn();
  }

  step(direction) {
    this.seek(this.nowS + direction * STEP_S);
  }

  // Let some real time pass.
  advance(elapsedS) {
    if (!this.isRunning) return;
    this.moveTo(this.nowS + this.speed * elapsedS);
    if (this.nowS >= this.durationS) this.toggle();
  }

  draw() {
    if (document.activeElement !== this.line || this.isRunning) this.line.value = this.nowS;
    setText(this.text, `${this.nowS.toFixed(1)} / ${this.durationS.toFixed(1)} s`);
  }
}

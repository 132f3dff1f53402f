// Controls that act on the running loop: latency of both directions, disturbances, figures.

import { element, pressed, slider } from "cockpit/words.js";

const SEND_AFTER_MS = 60; // a slider that is dragged sends this often at most
const GUST = { side_force_n: 1500, duration_s: 1.5 };
const OFFSET_RAD = 0.02;

const SLIDERS = [
  { key: "mean_s", label: "Mean", max: 600, step: 5, scale: 1000, unit: "ms" },
  { key: "spread_s", label: "Spread", max: 200, step: 5, scale: 1000, unit: "ms" },
  { key: "loss", label: "Loss", max: 30, step: 0.5, scale: 100, unit: "%" },
];

export class Network {
  constructor(app) {
    this.app = app;
    this.timers = {};
  }

  build(disabled) {
    this.load = { side_force_n: 0, steering_offset_rad: 0, friction: 1 };
    this.disabled = disabled;
    const scenario = this.app.head.scenario;
    return [
      this.direction("downlink", "Latency of commands", scenario?.downlink),
      this.direction("uplink", "Latency of measurements", scenario?.uplink),
      this.disturbances(),
    ];
  }

  direction(name, title, latency = { model: "normal", mean_s: 0, spread_s: 0, loss: 0 }) {
    const now = { ...latency };
    const models = this.app.head.choices.models.map((model) => element("option", { value: model, selected: model === now.model }, model));
    const model = element("select", { disabled: this.disabled, ariaLabel: `${title}: distribution`, onchange: () => {
      now.model = model.value;
      this.send(name, now);
    } }, ...models);
    const sliders = SLIDERS.map((slider) => this.slider(name, title, slider, now));
    return element("div", { className: "group" }, element("div", { className: "titled" }, element("h2", {}, title), model), ...sliders);
  }

  slider(name, title, { key, label, max, step, scale, unit }, now) {
    const attributes = { disabled: this.disabled, ariaLabel: `${title}: ${label.toLowerCase()} in ${unit}` };
    const made = slider(label, `${name}-${key}`, [0, max, step], (value) => `${value} ${unit}`, (value, input) => {
      now[key] = value / scale;
      // A constant latency has no spread: who moves that slider wants one.
      if (key === "spread_s" && now.model === "constant" && now[key] > 0) now.model = this.toNormal(input);
      this.send(name, now);
    }, attributes);
    made.set(scale * now[key]);
    return made.box;
  }

  toNormal(input) {
    const select = input.closest(".group").querySelector("select");
    select.value = "normal";
    return "normal";
  }

  send(direction, latency) {
    clearTimeout(this.timers[direction]);
    this.timers[direction] = setTimeout(() => this.app.wish({ do: "latency", direction, latency }), SEND_AFTER_MS);
  }

  disturbances() {
    const button = (label, id, title, act) => element("button", { type: "button", id, title, disabled: this.disabled, onclick: act }, label);
    this.offset = button("Steering offset", "offset", `Front wheel ${1000 * OFFSET_RAD} mrad to the left, unseen by its sensor (S)`, () => this.toggleOffset());
    this.ice = button("Ice", "ice", "Friction 0.3 instead of 1 (I)", () => this.toggleIce());
    const gust = button("Gust", "gust", `Side force of ${GUST.side_force_n} N for ${GUST.duration_s} s (G)`, () => this.gust());
    for (const toggle of [this.offset, this.ice]) pressed(toggle, false);
    return element("div", { className: "group" }, element("h2", {}, "Disturbances"), element("div", { className: "row" }, gust, this.offset, this.ice));
  }

  gust() {
    this.load.side_force_n = GUST.side_force_n;
    this.disturb();
    clearTimeout(this.timers.gust);
    this.timers.gust = setTimeout(() => {
      this.load.side_force_n = 0;
      this.disturb();
    }, 1000 * GUST.duration_s);
  }

  toggleOffset() {
    this.load.steering_offset_rad = this.load.steering_offset_rad ? 0 : OFFSET_RAD;
    pressed(this.offset, this.load.steering_offset_rad !== 0);
    this.disturb();
  }

  toggleIce() {
    this.setFriction(this.load.friction === 1 ? this.app.head.choices.ice_friction : 1);
  }

  setFriction(friction) {
    this.load.friction = friction;
    pressed(this.ice, this.load.friction !== 1);
    this.app.drive.felt.road.set(100 * friction);
    this.disturb();
  }

  disturb() {
    this.app.wish({ do: "disturb", ...this.load });
  }
}

// What the car does now: its motion as numbers; grip, load and rack force as bars with their limits.

import { byId, element, fixed, setText } from "cockpit/words.js";

const GRAVITY_M_S2 = 9.80665;
const RACK_SHARE = 0.05; // of the weight: the least end of the scale of the rack force
const GRIP_END = 1.25; // of the scale; the limit is at 1
const GRIP_LEVELS = [[0.95, "bad"], [0.7, "notice"]];

export class Gauges {
  constructor(app) {
    this.app = app;
  }

  build() {
    const { head } = this.app;
    const several = head.lanes.length > 1;
    this.lanes = head.lanes.map((facts) => this.lane(facts, several));
    byId("gauges").className = several ? "several" : "";
    byId("gauges").replaceChildren(...this.lanes.map(({ box }) => box));
    byId("gauges").hidden = true;
  }

  lane(facts, several) {
    const rest = facts.rear_axle_m / (facts.front_axle_m + facts.rear_axle_m);
    const by = {
      speed: gauge("Speed", "big"), yaw: gauge("Yaw rate"), side: gauge("Lateral"),
      rack: gauge("Rack force", "", 0.5),
      front: gauge("Grip front", "", 1 / GRIP_END), rear: gauge("Grip rear", "", 1 / GRIP_END),
      frontLoad: gauge("Load front", "", rest), rearLoad: gauge("Load rear", "", 1 - rest),
    };
    const name = several ? [element("h3", {}, facts.label)] : [];
    const note = element("p", { className: "note", role: "status" });
    return { by, facts, note, rackN: RACK_SHARE * facts.mass_kg * GRAVITY_M_S2, box: element("div", { className: "gauges" }, ...name, ...Object.values(by).map(({ box }) => box), note) };
  }

  draw(nowS) {
    byId("gauges").hidden = !this.lanes.filter((lane, index) => this.drawLane(lane, this.app.lanes[index], nowS, this.app.status?.lanes[index]?.grip ?? "")).length;
  }

  // Returns whether it is a car.
  drawLane(lane, rows, nowS, grip) {
    const read = (name) => rows.value(name, nowS);
    const share = read("front_load_share"), rackN = read("rack_force_n");
    lane.box.hidden = !Number.isFinite(share);
    if (lane.box.hidden) return false;
    setText(lane.note, grip);
    lane.note.hidden = !grip;
    const { by, facts: { mass_kg } } = lane;
    for (const [at, name] of [[by.speed, "speed_m_s"], [by.yaw, "yaw_rate_rad_s"], [by.side, "lateral_acceleration_m_s2"]]) {
      const signal = this.app.signals[name];
      setText(at.text, `${fixed(signal.scale * read(name), 1)} ${signal.unit}`);
    }
    for (const [at, used] of [[by.front, read("front_grip_used")], [by.rear, read("rear_grip_used")]]) {
      show(at, 0, used / GRIP_END, `${fixed(100 * used, 0)} %`);
      at.bar.className = `bar ${GRIP_LEVELS.find(([least]) => used >= least)?.[1] ?? "good"}`;
    }
    for (const [at, part] of [[by.frontLoad, share], [by.rearLoad, 1 - share]]) {
      const loadN = part * mass_kg * GRAVITY_M_S2;
      show(at, 0, part, mass_kg === null ? `${fixed(100 * part, 0)} %` : force(loadN));
    }
    by.rack.box.hidden = !Number.isFinite(rackN);
    lane.rackN = Math.max(lane.rackN, Math.abs(rackN) || 0);
    const to = 0.5 - 0.5 * (rackN / lane.rackN || 0); // left is left
    show(by.rack, Math.min(0.5, to), Math.max(0.5, to), force(rackN));
    return true;
  }
}

function force(valueN) {
  return Math.abs(valueN) < 1000 ? `${fixed(valueN, Math.abs(valueN) < 10 ? 1 : 0)} N` : `${fixed(valueN / 1000, 1)} kN`;
}

// A number, and a bar from a share of its width to another; the limit is a mark on it.
function gauge(label, kind = "", limit = null) {
  const text = element("b"), bar = element("i"), mark = element("u");
  const box = element("div", { className: `gauge ${kind}` }, element("span", {}, label), text);
  if (limit !== null) {
    mark.style.left = `${100 * limit}%`;
    box.append(element("div", { className: "track" }, bar, mark));
  }
  return { box, text, bar };
}

function show({ text, bar }, from, to, words) {
  const [left, right] = [from, to].map((share) => 100 * Math.min(Math.max(share, 0), 1));
  bar.style.left = `${left}%`;
  bar.style.width = `${right - left}%`;
  setText(text, words);
}

// What is read rather than seen: figures, lights with their causes, the list of frames.

import { asFill, lawLine } from "cockpit/theme.js";
import { byId, element, pressed, setText, shown } from "cockpit/words.js";

const SIGNS = { good: "✓", notice: "▲", bad: "✕", off: "○" };
const SLOW = 1.5; // a cycle that is longer than its period by this factor is marked

export class Figures {
  constructor(app) {
    this.app = app;
    this.cells = [];
  }

  build() {
    const { head, signals } = this.app;
    const several = head.lanes.length > 1;
    const names = head.figures.map((figure) => element("th", { scope: "col", title: figure.explanation }, several ? `${figure.label} [${signals[figure.signal].unit}]` : figure.label));
    this.cells = head.lanes.map(() => head.figures.map(() => element("span")));
    const lines = head.lanes.map((lane, index) => {
      const swatch = element("span", { className: "swatch" });
      swatch.style.background = asFill(lawLine(lane));
      const who = several ? [element("td", { className: "who" }, swatch, lane.label)] : [];
      const cells = head.figures.map((figure, at) =>
        element("td", { title: figure.explanation, "data-label": several ? names[at].textContent : figure.label }, this.cells[index][at], several ? "" : element("small", {}, signals[figure.signal].unit)));
      return element("tr", {}, ...who, ...cells);
    });
    const first = several ? [element("th", {}, "")] : [];
    byId("figures").className = several ? "several" : "";
    byId("figures").replaceChildren(element("table", {}, element("thead", {}, element("tr", {}, ...first, ...names)), element("tbody", {}, ...lines)));
  }

  draw(nowS) {
    const { head, signals, lanes } = this.app;
    this.cells.forEach((cells, lane) =>
      cells.forEach((cell, at) => {
        const signal = signals[head.figures[at].signal];
        setText(cell, shown(signal, lanes[lane].value(signal.name, nowS)));
      }));
  }
}

export class Lights {
  constructor(app) {
    this.app = app;
    this.said = "";
  }

  build() {
    const { head } = this.app;
    this.choices = head.lanes.map((lane, index) =>
      element("button", { type: "button", onclick: () => this.app.selectLane(index) }, `${index + 1} ${lane.label}`));
    const of = element("div", { className: "of", hidden: head.lanes.length < 2 }, ...this.choices);
    this.list = element("ul");
    byId("lights").replaceChildren(of, this.list);
    this.items = [];
  }

  draw(lightsOfLanes) {
    const lights = lightsOfLanes[this.app.lane] ?? [];
    this.choices.forEach((choice, index) => {
      pressed(choice, index === this.app.lane);
      const worst = worstOf(lightsOfLanes[index] ?? []);
      setText(choice, `${SIGNS[worst]} ${this.app.head.lanes[index].label}`);
    });
    while (this.items.length < lights.length) this.items.push(this.addItem());
    lights.forEach((light, index) => this.show(this.items[index], light));
    const grave = lights.filter((light) => light.level !== "good");
    this.say(grave.map((light) => `${light.name}: ${words(light.state)}, ${light.cause}`).join("; ") || "all good");
  }

  addItem() {
    const item = { sign: element("span", { className: "sign", ariaHidden: "true" }), name: element("span", { className: "name" }), state: element("b"), cause: element("div", { className: "cause" }) };
    item.box = element("li", {}, item.sign, element("div", {}, item.name, item.state), item.cause);
    this.list.append(item.box);
    return item;
  }

  show(item, light) {
    if (item.box.className !== light.level) item.box.className = light.level;
    setText(item.sign, SIGNS[light.level]);
    setText(item.name, light.name);
    setText(item.state, words(light.state));
    setText(item.cause, light.cause);
  }

  // For a screen reader: what has changed, and only that.
  say(text) {
    if (text === this.said) return;
    this.said = text;
    byId("said").textContent = text;
  }
}

function worstOf(lights) {
  return ["bad", "notice", "off"].find((level) => lights.some((light) => light.level === level)) ?? "good";
}

function words(state) {
  return state.replaceAll("_", " ");
}

export class Frames {
  constructor(app) {
    this.app = app;
  }

  build() {
    this.sum = element("p", { className: "sum" });
    this.list = element("ul");
    byId("frames").replaceChildren(this.sum, this.list);
    this.items = new Map();
  }

  draw(frames) {
    if (!frames?.rows || byId("frames").hidden) return;
    const refused = Object.entries(frames.refused).map(([cause, count]) => `${count} ${cause.replaceAll("_", " ")}`);
    setText(this.sum, `${frames.per_s} frames/s, refused: ${refused.join(", ") || "none"}. Cycle: median and longest of 15 s, against the DBC.`);
    for (const row of frames.rows) this.show(this.item(row), row);
  }

  item(row) {
    if (!this.items.has(row.id)) {
      const item = { payload: element("code"), cycle: element("span", { className: "cycle" }), signals: element("div", { className: "signals" }), counts: element("div", { className: "counts" }) };
      item.box = element("li", {}, element("div", { className: "top" }, element("code", {}, row.id), element("span", { className: "name" }, row.name), item.cycle), item.payload, item.signals, item.counts);
      this.items.set(row.id, item);
      this.list.append(item.box);
    }
    return this.items.get(row.id);
  }

  show(item, row) {
    setText(item.payload, row.payload || "not seen yet");
    setText(item.signals, row.signals ?? "");
    setText(item.cycle, cycleText(row));
    item.cycle.classList.toggle("slow", Boolean(row.cycle_s && row.cycle_s[0] > SLOW * row.period_s));
    item.box.classList.toggle("stale", Boolean(row.stale));
    const counts = [row.missing && `${row.missing} missing`, row.refused && `${row.refused} refused`, row.stale && "silent"];
    setText(item.counts, counts.filter(Boolean).join(", "));
  }
}

function cycleText(row) {
  if (row.period_s == null) return row.count === undefined ? "" : `${row.count}, when sent`;
  if (!row.cycle_s) return `every ${1000 * row.period_s} ms`;
  const [median, longest] = row.cycle_s.map((value) => (1000 * value).toFixed(1));
  return `${median} / ${longest} of ${Math.round(1000 * row.period_s)} ms`;
}

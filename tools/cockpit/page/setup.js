// What runs: presets that one click starts, and a choice of one's own; the programs; recordings.

import { byId, element, setText } from "cockpit/words.js";

export class Setup {
  constructor(app) {
    this.app = app;
  }

  scenarios() {
    const { scenario, choices } = this.app.head;
    const titles = [...new Set([...choices.scenarios.map((one) => one.title), scenario?.title].filter(Boolean))];
    const preset = element("select", { id: "preset", ariaLabel: "preset" }, ...titles.map((title) => element("option", { value: title, selected: title === scenario?.title }, title)));
    const chosen = () => choices.scenarios.find((one) => one.title === preset.value) ?? scenario;
    const go = element("button", { type: "button", id: "start", className: "primary", onclick: () => this.start(chosen()) }, "Start");
    const note = element("p", { className: "note" }, scenario?.note ?? "");
    const own = element("details", {}, element("summary", {}, "Choose law, vehicle, path …"), this.form());
    preset.onchange = () => setText(note, chosen().note);
    return element("div", { className: "group" }, element("h2", {}, "What drives"), element("div", { className: "preset" }, preset, go), note, own);
  }

  start(scenario) {
    this.app.wish({ do: "start", scenario });
  }

  form() {
    const { scenario, choices } = this.app.head;
    const now = scenario ?? choices.scenarios[0];
    const lanes = Array.from({ length: choices.lanes_max }, (_, lane) =>
      select(`Law ${lane + 1}`, lane ? ["none", ...choices.controllers] : choices.controllers, now.controllers[lane] ?? "none"));
    const plant = select("Vehicle", choices.plants, now.plant);
    const path = select("Path", choices.paths, now.path);
    const speed = number("Speed [km/h]", now.speed_km_h ?? "", { min: 0.5, max: 250, step: 0.5, placeholder: "of the vehicle" });
    const seed = number("Seed", now.seed, { min: 0, step: 1 });
    const read = (field) => field.lastChild.value;
    const go = element("button", { type: "submit", className: "primary" }, "Start");
    const submit = (event) => {
      event.preventDefault();
      this.start({
        ...now, title: "own choice", note: "",
        controllers: lanes.map(read).filter((name) => name !== "none"),
        plant: read(plant), path: read(path), seed: Number(read(seed)),
        speed_km_h: read(speed) === "" ? null : Number(read(speed)),
        sensor_period_ms: lanes.some((lane) => read(lane).startsWith("paper_")) ? 1 : 10,
      });
    };
    return element("form", { onsubmit: submit }, ...lanes, plant, path, speed, seed, element("p", { className: "note" }, go));
  }

  programs() {
    this.rows = this.app.head.lanes.flatMap((lane, index) => ["plant", "controller"].map((program) => this.program(lane, index, program)));
    const cells = this.rows.flatMap((row) => [row.label, row.buttons]);
    return element("div", { className: "group" }, element("h2", {}, "Programs"), element("div", { className: "programs" }, ...cells));
  }

  program(lane, index, program) {
    const act = (action) => () => this.app.wish({ do: "process", lane: index, program, action });
    const words = (label) => `${label} ${program} of ${lane.label}`;
    const button = (label, action) => element("button", { type: "button", title: words(label), ariaLabel: words(label), onclick: act(action) }, label);
    const state = element("span", { className: "state" }, "running");
    const several = this.app.head.lanes.length > 1;
    const buttons = { kill: button("Kill", "kill"), pause: button("Pause", "pause"), resume: button("Resume", "resume"), restart: button("Restart", "restart") };
    const box = element("span", { className: "row" }, ...Object.values(buttons));
    const name = lane.label === "hand" && program === "controller" ? "hand" : program;
    return { state, by: buttons, buttons: box, label: element("span", {}, several ? `${index + 1} ${name}` : name, element("br"), state), lane: index, program };
  }

  recording() {
    this.record = element("button", { type: "button", id: "record", title: "Record every frame (R)", onclick: () => this.toggleRecord() }, "Record");
    this.files = element("div", { className: "row" });
    const reset = element("button", { type: "button", title: "Let RMS and peak start again", onclick: () => this.app.wish({ do: "reset" }) }, "Reset RMS");
    return element("div", { className: "group" }, element("h2", {}, "Record"), element("div", { className: "row" }, this.record, reset), this.files);
  }

  toggleRecord() {
    this.app.wish({ do: "record", on: this.app.status?.recording_s == null });
  }

  draw(status) {
    for (const row of this.rows ?? []) {
      const state = status.programs[row.lane]?.[row.program] ?? "ended";
      setText(row.state, state);
      row.label.hidden = row.buttons.hidden = row.lane !== this.app.lane;
      const isGone = state.startsWith("ended");
      row.state.classList.toggle("gone", isGone || state === "paused");
      row.by.kill.hidden = row.by.pause.hidden = isGone;
      row.by.restart.hidden = !isGone;
      row.by.resume.hidden = state !== "paused";
      if (state === "paused") row.by.pause.hidden = true;
    }
    if (!this.record) return;
    const isOn = status.recording_s != null;
    setText(this.record, isOn ? `Stop (${Math.floor(status.recording_s)} s)` : "Record");
    this.record.setAttribute("aria-pressed", String(isOn));
    this.listFiles(isOn ? [] : status.recorded);
  }

  listFiles(names) {
    if (this.listed === String(names)) return;
    this.listed = String(names);
    const links = names.flatMap((name) => [name, name.replace(/\.log$/, ".html")]).map((name) =>
      element("a", { className: "download", href: `recording/${name}`, download: name }, name));
    this.files.replaceChildren(...links);
  }
}

function select(label, options, value) {
  const choices = options.map((option) => element("option", { value: option, selected: option === value }, option.replaceAll("_", " ")));
  return element("label", { className: "field" }, label, element("select", {}, ...choices));
}

function number(label, value, attributes) {
  return element("label", { className: "field" }, label, element("input", { type: "number", value, ...attributes }));
}

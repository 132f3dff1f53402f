// What the keys do, and the page that says so.

import { byId, element } from "cockpit/words.js";

const SIGNS_TEXT = [
  ["wanted", "the newest command on the bus"],
  ["in effect", "the command that the plant applies now, by the counter that it returns"],
  ["applied", "the angle of the wheels, as their sensor reports it"],
  ["deviation", "from the path to the car, drawn ×1 or ×10; left is up and positive"],
  ["latency", "what the network adds to one frame, as the plant reports it ten times a second"],
  ["round trip", "from a command to the first measurement that shows it in effect"],
  ["RMS, peak", "of the car's deviation from the path since the start, or since they were reset"],
];

const NAMES = { " ": "space", ArrowLeft: "←", ArrowRight: "→" };

// keys: { letter: [what, function] }; one without words is not listed
export function startKeys(keys) {
  const dialog = byId("help");
  const list = (entries) => element("dl", {}, ...entries.flatMap(([key, what]) => [element("dt", {}, key), element("dd", {}, what)]));
  const close = element("button", { type: "button", className: "close", onclick: () => dialog.close() }, "Close");
  const named = Object.entries(keys).filter(([, [what]]) => what).map(([key, [what]]) => [NAMES[key] ?? key.toUpperCase(), what]);
  const keyList = list([...named, ["1 … 4", "lights and frames of a lane"]]);
  keyList.className = "keys";
  dialog.append(
    close, element("h2", {}, "What the words mean"), list(SIGNS_TEXT), element("h2", {}, "Keys"), keyList,
    element("p", {}, "Charts: drag to zoom, double click to return."),
  );
  const help = () => (dialog.open ? dialog.close() : dialog.showModal());
  byId("help-open").onclick = help;
  document.addEventListener("keydown", (event) => {
    const isTyping = event.target.closest("input:not([type=range]), select, textarea");
    if (isTyping || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key === "?") help();
    // A focused button takes the space bar, a focused slider the arrows.
    if (event.key === " " && event.target.closest("button, a, summary")) return;
    if (event.key.startsWith("Arrow") && event.target.closest("input")) return;
    const entry = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (!entry) return;
    event.preventDefault();
    entry[1]();
  });
}

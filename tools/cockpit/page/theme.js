// Dark or light: the system's choice, until the user makes one. Colours come from the style sheet.

import { byId, setText } from "cockpit/words.js";

const KEY = "cockpit-theme";
const system = matchMedia("(prefers-color-scheme: light)");
let cache = new Map();

function stored() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // a page from a disk may have no store
  }
}

function apply(theme) {
  document.documentElement.dataset.theme = theme;
  setText(byId("theme"), theme === "dark" ? "Light" : "Dark");
  cache = new Map();
}

// A colour by its name in the style sheet, as "lane-0".
export function colour(name) {
  if (!cache.has(name)) {
    const style = getComputedStyle(document.documentElement);
    cache.set(name, style.getPropertyValue(`--${name}`).trim());
  }
  return cache.get(name);
}

// changed: called when the colours have changed
export function startTheme(changed) {
  const choose = () => {
    apply(stored() ?? (system.matches ? "light" : "dark"));
    changed();
  };
  const toggle = () => {
    const theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    try {
      localStorage.setItem(KEY, theme);
    } catch {
      // then it holds until the page is closed
    }
    apply(theme);
    changed();
  };
  system.addEventListener("change", choose);
  byId("theme").addEventListener("click", toggle);
  choose();
  return toggle;
}

const WIDTH_PX = 1.5; // of a line, to which the dashes of a law are

// Colour and dash of the law of a lane, as in all pictures; what is black there is the ink of the text.
export function lawLine({ line: [ink, dash] }) {
  return { ink: ink === "#000000" ? colour("text") : ink, dash: dash.map((part) => WIDTH_PX * part) };
}

// The same line as a background.
export function asFill({ ink, dash }) {
  if (!dash.length) return ink;
  let at = 0;
  const parts = dash.map((part, index) => `${index % 2 ? "transparent" : ink} ${at}px ${(at += part)}px`);
  return `repeating-linear-gradient(90deg, ${parts})`;
}

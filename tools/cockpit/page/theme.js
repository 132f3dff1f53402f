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

// Lines of lanes and signals differ by dashes too, not by colour alone.
export const DASHES = [[], [7, 3], [2, 3], [9, 3, 2, 3]];

// Small helpers for elements and numbers.

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

export function byId(id) {
  return document.getElementById(id);
}

// A value of a signal as it is shown, without its unit; a dash where there is none.
export function shown(signal, value) {
  if (!Number.isFinite(value)) return "–";
  return fixed(signal.scale * value, signal.digits);
}

// A number with so many digits, with a true minus and no negative zero; a dash where there is none.
export function fixed(value, digits) {
  return !Number.isFinite(value) ? "–" : value.toFixed(Math.abs(value) < 1000 ? digits : 0).replace(/^-(?=0\.?0*$)/, "").replace("-", "−");
}

// Lengths are in mm, or all of them in m: the figures of a signal, as they came, in one of the two.
export function inUnit(signal, isInMetres) {
  return isInMetres && signal.unit === "mm" ? { ...signal, unit: "m", scale: 1, digits: 2 } : signal;
}

// A length with its unit, in one of the two.
export function length(valueM, isInMetres) {
  return isInMetres ? `${fixed(valueM, 2)}\u00a0m` : `${fixed(1000 * valueM, 1)}\u00a0mm`;
}

export function pressed(button, isPressed) {
  button.setAttribute("aria-pressed", String(isPressed));
}

// Replace the content of an element only if it is to change: what is selected or focused stays.
export function setText(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

// A slider that tells its value: words of a value; moved, by whose hand; more attributes of the input.
// It gives the arrow keys back when the pointer lets it go; who moves it by keys keeps it.
export function slider(label, id, [min, max, step], words, moved, more = {}) {
  const text = element("output");
  const tell = () => setText(text, words(input.valueAsNumber));
  const input = element("input", { type: "range", min, max, step, id, ariaLabel: label, ...more, oninput: () => {
    tell();
    moved(input.valueAsNumber, input);
  } });
  input.addEventListener("pointerup", () => input.blur());
  const set = (value) => {
    input.value = value;
    tell();
  };
  return { box: element("label", { className: "slider" }, label, input, text), input, set };
}

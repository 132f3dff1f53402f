// The visitor's hand on arrow keys, mouse or finger, gamepad or USB wheel: one angle of all of them.

const PER_S = 1.6; // how fast a key turns, and how fast a wheel that was let go returns
const DRAG_PIXELS = 160; // from the middle to the stop
const DEAD = 0.04; // of a stick in its middle

export class Hand {
  // wheel: the element that can be dragged
  constructor(wheel) {
    this.position = 0; // from −1, right stop, to 1, left stop
    this.isOn = false; // whether somebody has touched anything yet
    this.keys = new Set();
    this.dragX = null;
    document.addEventListener("keydown", (event) => this.onKey(event, true));
    document.addEventListener("keyup", (event) => this.onKey(event, false));
    window.addEventListener("blur", () => this.keys.clear());
    wheel.addEventListener("pointerdown", (event) => {
      wheel.setPointerCapture(event.pointerId);
      this.dragX = event.clientX + DRAG_PIXELS * this.position;
      this.isOn = true;
    });
    wheel.addEventListener("pointermove", (event) => {
      if (this.dragX !== null) this.position = within((this.dragX - event.clientX) / DRAG_PIXELS);
    });
    for (const end of ["pointerup", "pointercancel"]) wheel.addEventListener(end, () => (this.dragX = null));
  }

  onKey(event, isDown) {
    if (!["ArrowLeft", "ArrowRight"].includes(event.key) || event.target.closest("input, select, textarea")) return;
    if (isDown) this.keys.add(event.key);
    else this.keys.delete(event.key);
    this.isOn ||= isDown;
  }

  letGo() {
    this.isOn = false;
    this.position = 0;
    this.dragX = null;
  }

  step(elapsedS) {
    const toLeft = this.keys.has("ArrowLeft") - this.keys.has("ArrowRight");
    const stick = [...(navigator.getGamepads?.() ?? [])].find((pad) => pad?.axes.length)?.axes[0] ?? 0;
    if (this.dragX !== null) return;
    if (!toLeft && Math.abs(stick) > DEAD) {
      this.position = within(-stick);
      this.isOn = true;
      return;
    }
    const most = PER_S * elapsedS;
    this.position += Math.min(Math.max(toLeft - this.position, -most), most);
  }
}

function within(position) {
  return Math.min(Math.max(position, -1), 1);
}

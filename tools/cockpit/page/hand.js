// The visitor's hand on arrow keys, mouse or finger, gamepad or USB wheel: one angle of all of them.

const RIM = 0.4; // radius of the rim over the width of the picture
const HUB = 0.3; // of the rim's radius: who takes the wheel there pulls it as at the top
const KEYS = ["ArrowLeft", "ArrowRight"], PEDALS = ["ArrowUp", "ArrowDown"];
const TRIGGERS = [6, 7]; // of a gamepad: brake, accelerator
const DEAD = 0.04; // of a stick in its middle

export class Hand {
  // wheel: the picture that can be dragged; stopRad: how far the picture turns, set by the driver's seat
  constructor(wheel) {
    this.wheel = wheel;
    this.stopRad = 1;
    this.hasPedals = false;
    this.keysPerS = 1; // how fast a key turns, and how fast a wheel that was let go returns
    this.position = 0; // from −1, right stop, to 1, left stop
    this.isOn = false; // whether somebody has touched anything yet
    this.keys = new Set();
    this.dragged = null; // where the pointer has the rim, from its middle, in radii
    this.pointerId = null; // of the finger that took the rim; a second one does nothing
    document.addEventListener("keydown", (event) => this.onKey(event, true));
    document.addEventListener("keyup", (event) => this.onKey(event, false));
    window.addEventListener("blur", () => this.keys.clear());
    wheel.addEventListener("pointerdown", (event) => {
      if (this.dragged) return;
      this.pointerId = event.pointerId;
      wheel.setPointerCapture(event.pointerId);
      this.dragged = this.placeOf(event);
      this.isOn = true;
    });
    wheel.addEventListener("pointermove", (event) => this.onDrag(event));
    wheel.addEventListener("lostpointercapture", (event) => {
      if (event.pointerId === this.pointerId) this.dragged = null;
    });
  }

  placeOf({ clientX, clientY }) {
    const { x, y, width, height } = this.wheel.getBoundingClientRect();
    return [(clientX - x - width / 2) / (RIM * width), (clientY - y - height / 2) / (RIM * width)];
  }

  // The rim follows the pointer, so that to the right is to the right above, and to the left below.
  onDrag(event) {
    if (!this.dragged || event.pointerId !== this.pointerId) return;
    const [fromX, fromY] = this.dragged, [toX, toY] = (this.dragged = this.placeOf(event));
    const from = Math.hypot(fromX, fromY), to = Math.hypot(toX, toY);
    const sweptRad = Math.atan2(fromX * toY - fromY * toX, fromX * toX + fromY * toY);
    const clockwiseRad = Math.min(from, to) < HUB ? toX - fromX : (sweptRad * (from + to)) / 2;
    this.position = within(this.position - clockwiseRad / this.stopRad);
  }

  onKey(event, isDown) {
    const isPedal = this.hasPedals && PEDALS.includes(event.key);
    if (!(isPedal || KEYS.includes(event.key)) || event.target.closest("input, select, textarea")) return;
    if (isPedal) event.preventDefault(); // the page would scroll
    if (isDown) this.keys.add(event.key);
    else this.keys.delete(event.key);
    this.isOn ||= isDown;
  }

  // Accelerator 1, brake −1.
  get pedal() {
    if (!this.hasPedals) return 0;
    const [brake, accelerator] = TRIGGERS.map((button) => pads().find((pad) => pad.buttons?.[button])?.buttons[button].value ?? 0);
    return within(accelerator - brake + this.keys.has("ArrowUp") - this.keys.has("ArrowDown"));
  }

  letGo() {
    this.isOn = false;
    this.position = 0;
    this.dragged = null;
  }

  step(elapsedS) {
    const toLeft = this.keys.has("ArrowLeft") - this.keys.has("ArrowRight");
    const stick = pads().find((pad) => pad.axes.length)?.axes[0] ?? 0;
    this.isOn ||= this.pedal > 0;
    if (this.dragged) return;
    if (!toLeft && Math.abs(stick) > DEAD) {
      this.position = within(-stick);
      this.isOn = true;
      return;
    }
    const most = this.keysPerS * elapsedS;
    this.position += Math.min(Math.max(toLeft - this.position, -most), most);
  }
}

function pads() {
  return [...(navigator.getGamepads?.() ?? [])].filter(Boolean);
}

function within(position) {
  return Math.min(Math.max(position, -1), 1);
}

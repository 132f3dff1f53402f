// The connection to the server: it comes back by itself when it was lost.

import { batchBytes } from "cockpit/rows.js";

const RETRY_MS = 1000;

export class Link {
  // on: { hello(head), rows(lane, batch), status(status), refusal(text), state(isOpen) }
  constructor(on) {
    this.on = on;
    this.open();
  }

  open() {
    this.socket = new WebSocket(new URL("socket", location.href).href.replace(/^http/, "ws"));
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => this.on.state(true);
    this.socket.onclose = () => {
      this.on.state(false);
      setTimeout(() => this.open(), RETRY_MS);
    };
    this.socket.onmessage = ({ data }) => {
      if (data instanceof ArrayBuffer) {
        for (let offset = 0; offset < data.byteLength; ) {
          const batch = new DataView(data, offset);
          offset += batchBytes(batch);
          this.on.rows(batch.getUint8(1), batch);
        }
        return;
      }
      const message = JSON.parse(data);
      if (message.kind === "hello") this.on.hello(message);
      else if (message.kind === "status") this.on.status(message);
      else if (message.refusal) this.on.refusal(message.refusal);
    };
  }

  wish(wish) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(wish));
  }
}

// The block of a replay: from the page itself, where it is one file, or from the server.

import { batchBytes, Rows } from "cockpit/rows.js";

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function embedded() {
  const script = document.getElementById("replay");
  if (!script) return null;
  return Uint8Array.from(atob(script.textContent.trim()), (letter) => letter.charCodeAt(0));
}

async function served() {
  if (!location.protocol.startsWith("http")) return null;
  const answer = await fetch("replay");
  return answer.status === 200 ? new Uint8Array(await answer.arrayBuffer()) : null;
}

// Returns { head, lanes }: rows of each, or null where there is no recording.
export async function readRecording() {
  const bytes = embedded() ?? (await served());
  if (!bytes) return null;
  const content = await inflated(bytes);
  const length = new DataView(content).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(content, 4, length)));
  const names = head.signals.map((signal) => signal.name);
  let at = 4 + length;
  const lanes = head.lanes.map(() => {
    const batch = new DataView(content, at);
    const rows = new Rows(names, Math.ceil(batch.getUint32(4, true) / 2) + 1);
    rows.take(batch);
    rows.isWhole = true;
    at += batchBytes(batch);
    return rows;
  });
  return { head, lanes };
}

// The rows of one lane: a time and the same columns of numbers in each, oldest first.

const KEPT_S = 120; // of a live lane: twice the longest span of a chart

function rowBytes(batch) {
  return 8 + 4 * batch.getUint16(2, true);
}

// How long a batch of rows is.
export function batchBytes(batch) {
  return 8 + batch.getUint32(4, true) * rowBytes(batch);
}

export class Rows {
  // names: of the columns; capacity: rows that are kept at least
  constructor(names, capacity) {
    this.names = names;
    this.capacity = capacity;
    this.length = 0;
    this.time = new Float64Array(2 * capacity);
    this.columns = Object.fromEntries(names.map((name) => [name, new Float32Array(2 * capacity)]));
  }

  static live(names, periodS) {
    return new Rows(names, Math.ceil(KEPT_S / periodS));
  }

  // Append the rows of a batch.
  take(batch) {
    const end = batchBytes(batch);
    for (let offset = 8; offset < end; offset += rowBytes(batch)) this.append(batch, offset);
  }

  append(batch, offset) {
    if (this.length === this.time.length) this.drop(this.capacity);
    const at = this.length++;
    this.time[at] = batch.getFloat64(offset, true);
    for (let index = 0; index < this.names.length; index++) {
      this.columns[this.names[index]][at] = batch.getFloat32(offset + 8 + 4 * index, true);
    }
  }

  // Forget the oldest rows, so that the memory stays as it is.
  drop(count) {
    this.time.copyWithin(0, count);
    for (const column of Object.values(this.columns)) column.copyWithin(0, count);
    this.length -= count;
  }

  get endS() {
    return this.length ? this.time[this.length - 1] : 0;
  }

  // Index of the newest row at or before a time, -1 before all of them.
  indexAt(timeS) {
    let low = 0;
    let high = this.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= timeS) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  value(name, timeS) {
    const at = this.indexAt(timeS);
    return at < 0 ? NaN : this.columns[name][at];
  }
}
